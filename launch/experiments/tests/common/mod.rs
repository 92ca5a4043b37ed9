//! A walk made by hand: rest, then straight ahead with a slow turn, before a wall. Small, because what faults do does not depend
//! on what is seen.
#![allow(dead_code, missing_docs, unreachable_pub, reason = "each test binary uses its own part")]

use evac_config::ImuFromLidar;
use evac_experiments::{Frame, View, Walk};
use evac_frames::{FrameHeader, ImuSample, Point, ScanHeader};
use evac_geometry::STANDARD_GRAVITY;
use evac_geometry::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use evac_simulator::Random;
use evac_stage::Rig;

pub const SECONDS: f64 = 30.0;
/// The walk begins with so much rest, seconds.
pub const REST_S: f64 = 4.0;
const SPEED_M_S: f64 = 1.1;
const SHOTS: usize = 200;
const SAMPLE_NS: i64 = 5_000_000;
const FRAME_NS: i64 = 100_000_000;

/// Rate about z: none at rest, half a degree a second for a moment, then a real turn.
fn rate(t: f64) -> f64 {
    let since = t - REST_S;
    let degrees = if since < 0.0 {
        0.0
    } else if since < 0.15 {
        0.5
    } else {
        20.0
    };
    degrees * std::f64::consts::PI / 180.0
}

pub fn walk(seed: u64) -> Walk {
    let mut random = Random::new(seed, 0);
    let imu: Vec<ImuSample> = (0..=(SECONDS * 200.0) as i64).map(|k| sample(k, &mut random)).collect();
    let frames: Vec<Frame> = (0..(SECONDS * 10.0) as i64).map(|k| frame(k, &mut random)).collect();
    let imu_from_lidar =
        ImuFromLidar { translation_m: [0.05, -0.02, 0.06], roll_pitch_yaw_deg: [0.5, -1.0, 1.5] };
    Walk { name: "by hand".to_owned(), rig: Rig { imu_from_lidar }, frames }.with_imu(&imu)
}

fn sample(k: i64, random: &mut Random) -> ImuSample {
    let t = (k * SAMPLE_NS) as f64 * 1e-9;
    let noise = random.normals().map(|noise| noise * 0.05_f64.to_radians());
    // The bias that auto-zero hides.
    let bias = [0.001, -0.002, 0.0];
    ImuSample {
        seq: k as u64,
        stamp_ns: k * SAMPLE_NS,
        gyro: [noise[0] + bias[0], noise[1] + bias[1], noise[2] * 0.1 + rate(t)],
        accel: [0.0, 0.0, STANDARD_GRAVITY],
        ..ImuSample::default()
    }
}

fn frame(k: i64, random: &mut Random) -> Frame {
    let end_ns = (k + 1) * FRAME_NS;
    let walked = ((end_ns as f64 * 1e-9 - REST_S) * SPEED_M_S).max(0.0);
    let points: Vec<Point> = (0..SHOTS)
        .map(|shot| {
            let offset_ns = shot as i64 * FRAME_NS / SHOTS as i64;
            let wide = 0.3 * (2.0 * random.uniform() - 1.0);
            let high = 0.3 * (2.0 * random.uniform() - 1.0);
            match shot % 50 {
                0 => Point::new(0.0, 0.0, 0.0, offset_ns, 0),
                _ => Point::new(6.0, (6.0 * wide) as f32, (6.0 * high) as f32, offset_ns, 50),
            }
        })
        .collect();
    let frame = FrameHeader { seq: k as u64, start_ns: end_ns - FRAME_NS, end_ns, ..FrameHeader::default() };
    let header = ScanHeader { frame, points: SHOTS as u32, ..ScanHeader::default() };
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3);
    let truth = Isometry3::from_parts(Translation3::from(heading * Vector3::new(walked, 0.0, 0.0)), heading);
    Frame { header, points: points.into(), imu: Vec::new(), truth, view: View::Unknown }
}
