//! Map updates and snapshots.

use evac_frames::{MapHeader, Voxel};
use evac_ports::services::{MapSnapshot, MapUpdate, SNAPSHOT_REQUEST};
use evac_ports::{Bus, FramePublisher, Listener, PortError, RequestReceiver};

use super::{StageOutput, failed, keep, stamp};
use crate::StageError;
use crate::follow::{Followed, MapFollower, Routed};

/// Where map updates and snapshots go.
#[derive(Debug, Default)]
pub struct MapOutput {
    /// Updates published, newest last, where no shared memory is connected.
    pub memory: Vec<(MapHeader, Vec<Voxel>)>,
    /// Snapshots published, newest last, where no shared memory is connected.
    pub snapshots: Vec<(MapHeader, Vec<Voxel>)>,
    /// Lets a test ask for a snapshot where no shared memory is connected.
    pub request_snapshot: bool,
    newest_only: bool,
    /// Epoch of the mapper that began the map, where it was another.
    map_epoch: Option<u32>,
    port: Option<MapPort>,
}

#[derive(Debug)]
struct MapPort {
    updates: FramePublisher<MapUpdate>,
    snapshots: FramePublisher<MapSnapshot>,
    requests: RequestReceiver,
    epoch: u32,
}

impl MapOutput {
    /// Keeps only the newest update in memory and reuses its buffer, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        Self { newest_only: true, ..Self::default() }
    }

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
        let header = MapHeader { voxels: len as u32, map_epoch: self.lineage(), ..*header };
        let Some(port) = &self.port else {
            keep(&mut self.memory, self.newest_only, header, len, fill);
            return Ok(());
        };
        port.updates.publish(len, fill, || stamped(header, port.epoch)).map_err(failed)
    }

    /// Whether a late joiner has asked for a snapshot since the last call.
    pub fn snapshot_requested(&mut self) -> bool {
        match &self.port {
            Some(port) => port.requests.take(),
            None => std::mem::take(&mut self.request_snapshot),
        }
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
        let header = MapHeader { voxels: len as u32, map_epoch: self.lineage(), ..*header };
        let Some(port) = &self.port else {
            keep(&mut self.snapshots, self.newest_only, header, len, fill);
            return Ok(());
        };
        port.snapshots.publish(len, fill, || stamped(header, port.epoch)).map_err(failed)
    }
}

/// The header with the sender and the time of sending.
fn stamped(mut header: MapHeader, epoch: u32) -> MapHeader {
    stamp(&mut header.frame, epoch);
    header
}

impl StageOutput for MapOutput {
    const SERVICES: &'static [&'static str] = &["map/update", "map/snapshot"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        let port = MapPort {
            updates: FramePublisher::open(bus)?,
            snapshots: FramePublisher::open(bus)?,
            requests: RequestReceiver::open(bus, SNAPSHOT_REQUEST)?,
            epoch,
        };
        Ok(Self { port: Some(port), ..Self::default() })
    }

    fn listeners(&self, bus: &Bus) -> Result<Vec<Listener>, PortError> {
        Ok(vec![RequestReceiver::listener(bus, SNAPSHOT_REQUEST)?])
    }

    fn lineage(&self) -> u32 {
        self.map_epoch.unwrap_or(self.port.as_ref().map_or(0, |port| port.epoch))
    }

    fn go_on_with(&mut self, lineage: Option<u32>) {
        self.map_epoch = lineage;
    }
}

impl Followed for MapOutput {
    type Follower = MapFollower;

    fn note(&mut self, routed: &Routed<'_, Self>) {
        self.map_epoch = Some(routed.header.map_epoch);
    }

    fn repeat(&mut self, routed: Routed<'_, Self>) -> Result<(), StageError> {
        let voxels = routed.voxels;
        self.publish(routed.header, voxels.len(), |i| voxels.get(i).copied().unwrap_or_default())
    }
}
