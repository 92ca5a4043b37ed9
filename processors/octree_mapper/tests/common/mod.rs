//! A corridor, and what a Mid-40-like cone sees of it.
#![allow(clippy::unwrap_used, reason = "a helper that fails, fails its test")]

use evac_frames::{FrameHeader, Point, PoseFrame, ScanHeader, TrackingState, scan_flags};
use evac_geometry::nalgebra::{Isometry3, Point3, Vector3};
use evac_geometry::set_map_from_lidar;
use evac_octree_mapper::{OctreeMapper, OctreeMapperConfig};
use evac_stage::{Counters, MapOutput, Rig, ScanWithPose, Stage};

pub(crate) const FLOOR: f64 = -1.1;
const LOW: [f64; 3] = [-3.0, -1.5, FLOOR];
const HIGH: [f64; 3] = [15.0, 1.5, 1.5];
const RAYS: usize = 10_000;

/// One frame: 38.4 degree cone, 2 cm range noise, `seq` turns the pattern and seeds the noise.
pub(crate) fn scan(seq: u64, map_from_lidar: &Isometry3<f64>) -> (ScanHeader, Vec<Point>, PoseFrame) {
    let frame = FrameHeader {
        seq,
        start_ns: seq as i64 * 100_000_000,
        end_ns: (seq as i64 + 1) * 100_000_000,
        ..Default::default()
    };
    let mut random = seq.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let points: Vec<Point> = (0..RAYS)
        .map(|i| {
            let off = 19.2f64.to_radians() * ((i as f64 + 0.5) / RAYS as f64).sqrt();
            let angle = 2.399_963 * i as f64 + seq as f64;
            let ray = Vector3::new(off.cos(), off.sin() * angle.cos(), off.sin() * angle.sin());
            let range = range(map_from_lidar, &ray) + 0.02 * gauss(&mut random);
            Point::new((ray.x * range) as f32, (ray.y * range) as f32, (ray.z * range) as f32, 0, 100)
        })
        .collect();
    let header = ScanHeader {
        frame,
        scan_flags: scan_flags::DESKEWED,
        points: points.len() as u32,
        ..Default::default()
    };
    let mut pose = PoseFrame { frame, state: TrackingState::Tracking as u32, ..Default::default() };
    set_map_from_lidar(&mut pose, map_from_lidar);
    (header, points, pose)
}

/// Distance to the corridor's surface along a ray from inside.
fn range(map_from_lidar: &Isometry3<f64>, ray: &Vector3<f64>) -> f64 {
    let (origin, direction) = (map_from_lidar * Point3::origin(), map_from_lidar * ray);
    (0..3)
        .map(|k| {
            let wall = if direction[k] > 0.0 { HIGH[k] } else { LOW[k] };
            if direction[k] == 0.0 { f64::INFINITY } else { (wall - origin[k]) / direction[k] }
        })
        .fold(f64::INFINITY, f64::min)
}

fn gauss(random: &mut u64) -> f64 {
    (0..12)
        .map(|_| {
            *random ^= *random << 13;
            *random ^= *random >> 7;
            *random ^= *random << 17;
            (*random >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        })
        .sum()
}

/// A pose `x` metres down the corridor, turned by `yaw_deg`.
pub(crate) fn pose(x: f64, yaw_deg: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::x() * x, Vector3::z() * yaw_deg.to_radians())
}

/// A mapper whose configuration is right.
pub(crate) fn mapper(config: OctreeMapperConfig) -> OctreeMapper {
    OctreeMapper::new(config, &Rig::default()).unwrap()
}

/// Gives one scan to the mapper.
pub(crate) fn feed(
    mapper: &mut OctreeMapper,
    (header, points, pose): &(ScanHeader, Vec<Point>, PoseFrame),
    output: &mut MapOutput,
    counters: &mut Counters,
) {
    mapper.process(ScanWithPose { header, points, pose }, output, counters).unwrap();
}
