//! What stages write to: shared memory in a pipeline, plain vectors in tests and benches.

use evac_frames::{GridHeader, MapHeader, Point, PoseFrame, ScanHeader, Voxel};

use crate::StageError;

/// Where deskewed scans go.
#[derive(Debug, Default)]
pub struct ScanOutput {
    /// What was published, newest last (memory sink).
    pub memory: Vec<(ScanHeader, Vec<Point>)>,
}

impl ScanOutput {
    /// Publishes a scan of `len` points; `fill(i)` is called once for each index in order and its result written
    /// straight into the loaned memory. `header.points` is set to `len`.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        header: &ScanHeader,
        len: usize,
        fill: impl FnMut(usize) -> Point,
    ) -> Result<(), StageError> {
        let mut header = *header;
        header.points = len as u32;
        self.memory.push((header, (0..len).map(fill).collect()));
        Ok(())
    }
}

/// Where poses go.
#[derive(Debug, Default)]
pub struct PoseOutput {
    /// What was published, newest last (memory sink).
    pub memory: Vec<PoseFrame>,
}

impl PoseOutput {
    /// Publishes a pose.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, pose: &PoseFrame) -> Result<(), StageError> {
        self.memory.push(*pose);
        Ok(())
    }
}

/// Where map updates and snapshots go.
#[derive(Debug, Default)]
pub struct MapOutput {
    /// Updates published, newest last (memory sink).
    pub memory: Vec<(MapHeader, Vec<Voxel>)>,
    /// Snapshots published, newest last (memory sink).
    pub snapshots: Vec<(MapHeader, Vec<Voxel>)>,
    /// Lets a test ask for a snapshot (memory sink).
    pub request_snapshot: bool,
}

impl MapOutput {
    /// Publishes an update; `header.voxels` is set to `len`, `fill(i)` is called once for each index in order.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(
        &mut self,
        header: &MapHeader,
        len: usize,
        fill: impl FnMut(usize) -> Voxel,
    ) -> Result<(), StageError> {
        let mut header = *header;
        header.voxels = len as u32;
        self.memory.push((header, (0..len).map(fill).collect()));
        Ok(())
    }

    /// Whether a late joiner has asked for a snapshot since the last call.
    pub fn snapshot_requested(&mut self) -> bool {
        std::mem::take(&mut self.request_snapshot)
    }

    /// Publishes the whole map for late joiners; as [`Self::publish`], with `map_flags::SNAPSHOT` in the header.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish_snapshot(
        &mut self,
        header: &MapHeader,
        len: usize,
        fill: impl FnMut(usize) -> Voxel,
    ) -> Result<(), StageError> {
        let mut header = *header;
        header.voxels = len as u32;
        self.snapshots.push((header, (0..len).map(fill).collect()));
        Ok(())
    }
}

/// Where flat maps go.
#[derive(Debug, Default)]
pub struct GridOutput {
    /// What was published, newest last (memory sink).
    pub memory: Vec<(GridHeader, Vec<i8>)>,
}

impl GridOutput {
    /// Publishes a plan of `header.width * header.height` cells; `fill(i)` is called once for each index in order.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, header: &GridHeader, fill: impl FnMut(usize) -> i8) -> Result<(), StageError> {
        let len = header.width as usize * header.height as usize;
        self.memory.push((*header, (0..len).map(fill).collect()));
        Ok(())
    }
}

/// For sinks that write files only.
#[derive(Debug, Default)]
pub struct NoOutput;
