//! Faults of the scans and of the recording as a whole.

use evac_frames::Point;
use evac_simulator::Random;

use crate::{Frame, Walk};

pub(super) fn range_bias(walk: &Walk, metres: f32) -> Walk {
    changed(walk, |point| {
        let range = (point.x * point.x + point.y * point.y + point.z * point.z).sqrt();
        if !point.is_return() || !point.is_finite() {
            return *point;
        }
        let longer = (range + metres) / range;
        point.moved_to(point.x * longer, point.y * longer, point.z * longer)
    })
}

pub(super) fn corrupt(walk: &Walk, random: &mut Random) -> Walk {
    const SHARE: f64 = 0.05;
    const REACH_M: f64 = 40.0;
    changed(walk, |point| {
        if random.uniform() >= SHARE {
            return *point;
        }
        let mut anywhere = || ((2.0 * random.uniform() - 1.0) * REACH_M) as f32;
        let place = [anywhere(), anywhere(), anywhere()];
        match (random.uniform() * 3.0) as u32 {
            0 => point.moved_to(place[0], place[1], place[2]),
            1 => point.moved_to(f32::NAN, place[1], place[2]),
            _ => point.moved_to(0.0, 0.0, 0.0),
        }
    })
}

/// Scans of the last second of every ten never came; their numbers are missing.
pub(super) fn gaps(walk: &Walk) -> Walk {
    const EVERY_NS: i64 = 10_000_000_000;
    const HEARD_NS: i64 = 9_000_000_000;
    let mut without = walk.clone();
    let first_ns = walk.frames.first().map_or(0, |frame| frame.header.frame.start_ns);
    without.frames.retain(|frame| (frame.header.frame.start_ns - first_ns) % EVERY_NS < HEARD_NS);
    without.with_imu(&walk.imu())
}

/// Moves all stamps so that the first scan starts at `start_ns`.
pub(super) fn stamps_from(walk: &Walk, start_ns: i64) -> Walk {
    let mut moved = walk.clone();
    let by_ns = start_ns - walk.frames.first().map_or(0, |frame| frame.header.frame.start_ns);
    for frame in &mut moved.frames {
        frame.header.frame.start_ns += by_ns;
        frame.header.frame.end_ns += by_ns;
        frame.imu.iter_mut().for_each(|sample| sample.stamp_ns += by_ns);
    }
    moved
}

/// Leaves out everything before the walker is in full stride.
pub(super) fn start_walking(walk: &Walk) -> Walk {
    const STRIDE_M_S: f64 = 0.7;
    const FRAMES: usize = 5;
    let count = walk.frames.len();
    let strides = |index: &usize| (*index..index + FRAMES).all(|near| walk.speed(near) > STRIDE_M_S);
    let first = (0..count).find(strides).map_or(count / 10, |index| index + FRAMES);
    let (Some(from), Some(origin)) = (walk.frames.get(first), walk.frames.get(first)) else {
        return walk.clone();
    };
    let (from_ns, truth_from_origin) = (from.header.frame.start_ns, origin.truth.inverse());
    let heading = level_of(&truth_from_origin.inverse());
    let mut imu = walk.imu();
    imu.retain(|sample| sample.stamp_ns >= from_ns);
    let mut cut = walk.clone();
    cut.frames.drain(..first);
    for (frame, seq) in cut.frames.iter_mut().zip(0..) {
        frame.header.frame.seq = seq;
        frame.truth = heading.inverse() * frame.truth;
    }
    cut.with_imu(&imu)
}

/// The level frame at a pose's place, its x axis below the pose's.
fn level_of(pose: &evac_geometry::nalgebra::Isometry3<f64>) -> evac_geometry::nalgebra::Isometry3<f64> {
    use evac_geometry::nalgebra::{Isometry3, UnitQuaternion, Vector3};
    let forward = pose.rotation * Vector3::x();
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), forward.y.atan2(forward.x));
    Isometry3::from_parts(pose.translation, yaw)
}

/// The walk with every point replaced.
pub(super) fn changed(walk: &Walk, mut change: impl FnMut(&Point) -> Point) -> Walk {
    let mut walk = walk.clone();
    for frame in &mut walk.frames {
        frame.points = frame.points.iter().map(&mut change).collect();
        recount(frame);
    }
    walk
}

/// Keeps the header's count of shots without return true.
pub(super) fn recount(frame: &mut Frame) {
    frame.header.no_return = frame.points.iter().filter(|point| !point.is_return()).count() as u32;
}
