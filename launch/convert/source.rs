//! A cloud file that is read as often as the filters need.

use std::path::PathBuf;

use evac_formats::FormatError;
use evac_formats::cloud::{Origin, Reader};
use evac_octree_mapper::CloudSource;

use super::tiles::arranged;
use crate::progress::bar;

/// Points between two steps of the progress bar.
const STEP: u64 = 65_536;
/// Clouds of up to so many points (0.2 GB while they are put in order) are kept.
const KEPT: u64 = 8_000_000;

/// The points of a file.
pub(crate) struct FileSource {
    path: PathBuf,
    origin: Origin,
    /// Whether there will be more than one pass.
    again: bool,
    kept: Option<Vec<[f32; 3]>>,
    passes: u32,
    points: u64,
    first: Option<[f32; 3]>,
}

impl FileSource {
    pub(crate) fn new(path: PathBuf, origin: Origin, again: bool) -> Self {
        Self { path, origin, again, kept: None, passes: 0, points: 0, first: None }
    }

    /// Points that the last pass has read.
    pub(super) fn points(&self) -> u64 {
        self.points
    }

    /// The first point with numbers.
    pub(super) fn first(&self) -> Option<[f32; 3]> {
        self.first
    }

    pub(super) fn passes(&self) -> u32 {
        self.passes
    }

    fn read(&mut self, mut visit: impl FnMut([f32; 3])) -> Result<(), FormatError> {
        let reader = Reader::open(&self.path, self.origin)?;
        let announced = reader.points();
        let bar = bar(announced, &format!("points, pass {}", self.passes));
        self.points = 0;
        for point in reader {
            let point = point.inspect_err(|_| bar.finish_and_clear())?;
            self.points += 1;
            if self.points.is_multiple_of(STEP) {
                bar.set_position(self.points);
            }
            if self.first.is_none() && point.is_finite() {
                self.first = Some([point.x, point.y, point.z]);
            }
            visit([point.x, point.y, point.z]);
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Whether the points are in memory; reads them where they may be.
    fn keep(&mut self) -> Result<bool, FormatError> {
        if self.kept.is_none() && self.again && Reader::open(&self.path, self.origin)?.points() <= KEPT {
            let mut points = Vec::new();
            self.read(|point| points.push(point))?;
            self.kept = Some(arranged(&points));
        }
        Ok(self.kept.is_some())
    }
}

impl CloudSource for FileSource {
    type Error = FormatError;

    fn each(&mut self, visit: impl FnMut([f32; 3])) -> Result<(), FormatError> {
        self.passes += 1;
        if !self.keep()? {
            return self.read(visit);
        }
        self.kept.iter().flatten().copied().for_each(visit);
        Ok(())
    }
}
