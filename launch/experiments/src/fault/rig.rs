//! A rig that was measured wrongly: the walk stays, what the stages are told changes.

use evac_config::ImuFromLidar;
use evac_geometry::exp_so3;
use evac_geometry::nalgebra::Vector3;
use evac_simulator::Random;
use evac_stage::Rig;

use crate::Walk;

/// The given rotation is off by `degrees` about a random axis.
pub(super) fn rotated(walk: &Walk, degrees: f64, random: &mut Random) -> Walk {
    let wrong = exp_so3(&(direction(random) * degrees.to_radians())) * walk.rig.imu_from_lidar().rotation;
    let (roll, pitch, yaw) = wrong.euler_angles();
    let roll_pitch_yaw_deg = [roll, pitch, yaw].map(f64::to_degrees);
    with(walk, ImuFromLidar { roll_pitch_yaw_deg, ..walk.rig.imu_from_lidar })
}

/// The given lever arm is off by `metres` in a random direction.
pub(super) fn moved(walk: &Walk, metres: f64, random: &mut Random) -> Walk {
    let wrong = Vector3::from(walk.rig.imu_from_lidar.translation_m) + direction(random) * metres;
    with(walk, ImuFromLidar { translation_m: wrong.into(), ..walk.rig.imu_from_lidar })
}

fn with(walk: &Walk, imu_from_lidar: ImuFromLidar) -> Walk {
    Walk { rig: Rig { imu_from_lidar }, ..walk.clone() }
}

/// Evenly distributed over the sphere.
fn direction(random: &mut Random) -> Vector3<f64> {
    Vector3::from(random.normals()).try_normalize(1e-9).unwrap_or_else(Vector3::z)
}
