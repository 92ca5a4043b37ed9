//! A real mapper between two walls, as the writer of the map's stream.
#![allow(dead_code, clippy::unwrap_used, reason = "parts of tests, of which each file uses some")]

use evac_frames::{MapHeader, Point, PoseFrame, ScanHeader, Voxel};
use evac_octree::{MapConfig, OctreeMap};
use evac_octree_mapper::{OctreeMapper, OctreeMapperConfig};
use evac_ports::Bus;
use evac_stage::{Counters, MapMessage, MapOutput, Rig, ScanWithPose, Stage, StageOutput};

use super::{frame, pose};

/// A mapper that walks between two walls; every third scan is a key frame.
pub(crate) struct Mapper {
    mapper: OctreeMapper,
    output: MapOutput,
}

impl Mapper {
    pub(crate) fn start(bus: &Bus) -> Self {
        Self::start_as(bus, 0)
    }

    pub(crate) fn start_as(bus: &Bus, epoch: u32) -> Self {
        let mapper = OctreeMapper::new(OctreeMapperConfig::default(), &Rig::default()).unwrap();
        Self { mapper, output: MapOutput::open(bus, epoch).unwrap() }
    }

    /// Maps the scan of `seq` at its pose.
    pub(crate) fn map(&mut self, seq: u64) {
        let (header, points) = (ScanHeader { frame: frame(seq), ..ScanHeader::default() }, walls());
        let pose = walk(seq);
        let input = ScanWithPose { header: &header, points: &points, pose: &pose };
        self.mapper.process(input, &mut self.output, &mut Counters::default()).unwrap();
    }

    /// What the run loop does while no scan comes.
    pub(crate) fn idle(&mut self) {
        self.mapper.serve(&mut self.output).unwrap();
    }

    pub(crate) fn bits(&self) -> Vec<Bits> {
        bits(self.mapper.map().voxels())
    }
}

/// 0.1 m a scan; key frames are 0.3 m apart.
pub(crate) fn walk(seq: u64) -> PoseFrame {
    pose(seq)
}

/// A grid of 5 cm on two walls, 1.5 m to the left and right.
fn walls() -> Vec<Point> {
    let (columns, rows) = (0..80, -10..20);
    let place =
        |(i, j, side): (i32, i32, f32)| Point::new(1.0 + 0.05 * i as f32, 1.5 * side, 0.05 * j as f32, 0, 0);
    let grid = columns.flat_map(|i| rows.clone().map(move |j| (i, j)));
    grid.flat_map(|(i, j)| [(i, j, -1.0), (i, j, 1.0)]).map(place).collect()
}

/// A voxel that compares bit for bit.
pub(crate) type Bits = ([u16; 3], u16, u32);

fn bits(voxels: impl Iterator<Item = Voxel>) -> Vec<Bits> {
    voxels.map(|voxel| (voxel.key, voxel.flags, voxel.log_odds.to_bits())).collect()
}

/// A consumer's copy of the map.
#[derive(Default)]
pub(crate) struct Copy {
    map: Option<OctreeMap>,
    /// Headers of all messages, in order.
    pub(crate) headers: Vec<MapHeader>,
}

impl Copy {
    pub(crate) fn take(&mut self, message: MapMessage<'_>, snapshot: bool) {
        if snapshot {
            self.map = None;
        }
        let new = || OctreeMap::new(MapConfig::new(message.header.resolution)).unwrap();
        let map = self.map.get_or_insert_with(new);
        message.voxels.iter().for_each(|voxel| map.apply(voxel).unwrap());
        self.headers.push(*message.header);
    }

    pub(crate) fn bits(&self) -> Vec<Bits> {
        self.map.as_ref().map_or_else(Vec::new, |map| bits(map.voxels()))
    }

    pub(crate) fn seqs(&self) -> Vec<u64> {
        self.headers.iter().map(|header| header.frame.seq).collect()
    }
}
