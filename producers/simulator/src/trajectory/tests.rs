use super::*;
use evac_geometry::{exp_so3, log_so3};

use crate::random::Random;

fn walk() -> Trajectory {
    let route = Route::start([0.0; 3], 0.0, 1.1, 85.0)
        .stand(3.0)
        .walk_to(6.0, 0.0)
        .walk_to(6.0, 4.0)
        .stand(1.0)
        .climb_to(6.0, 9.0, [1.0, 4.0], 1.7)
        .turn(180.0)
        .stand(0.5);
    Trajectory::new(route, Gait::new(1.0, &mut Random::new(5, 0)), [0.01, -0.02])
}

#[test]
fn derivatives_of_the_pose_are_the_velocities_everywhere() {
    let walk = walk();
    let h = 1e-4;
    let mut t = 0.0101;
    while t < walk.duration_s() {
        let (before, now, after) = (walk.at(t - h), walk.at(t), walk.at(t + h));
        let way = after.world_from_imu.translation.vector - before.world_from_imu.translation.vector;
        assert!((way / (2.0 * h) - now.velocity).norm() < 2e-5, "velocity at {t}");
        let gain = (after.velocity - before.velocity) / (2.0 * h);
        assert!((gain - now.acceleration).norm() < 2e-3, "acceleration at {t}");
        let turn = log_so3(&(before.world_from_imu.rotation.inverse() * after.world_from_imu.rotation));
        assert!((turn / (2.0 * h) - now.angular_velocity).norm() < 1e-5, "angular velocity at {t}");
        t += 0.0173;
    }
}

#[test]
fn the_ideal_imu_integrates_back_to_the_pose_over_ten_seconds() {
    let walk = walk();
    let h = 0.005;
    let start = walk.at(2.0);
    let (mut p, mut v) = (start.world_from_imu.translation.vector, start.velocity);
    let mut q = start.world_from_imu.rotation;
    let gravity = Vector3::z() * -STANDARD_GRAVITY;
    for k in 0..2000 {
        let (a, b) = (walk.at(2.0 + h * f64::from(k)), walk.at(2.0 + h * f64::from(k + 1)));
        let turned = q * exp_so3(&((a.angular_velocity + b.angular_velocity) * (h / 2.0)));
        let gain = (q * a.specific_force() + turned * b.specific_force()) / 2.0 + gravity;
        p += v * h + gain * (h * h / 2.0);
        v += gain * h;
        q = turned;
    }
    let end = walk.at(12.0);
    let off = (p - end.world_from_imu.translation.vector).norm();
    let turned = log_so3(&(q.inverse() * end.world_from_imu.rotation)).norm().to_degrees();
    assert!(off < 0.02, "position is off by {off} m");
    assert!(turned < 0.02, "rotation is off by {turned} degrees");
}

#[test]
fn the_walker_stands_exactly_still_for_the_first_three_seconds_and_has_moved_after_four() {
    let walk = walk();
    for k in 0..300 {
        let motion = walk.at(f64::from(k) * 0.01);
        assert_eq!(motion.velocity, Vector3::zeros());
        assert_eq!(motion.angular_velocity, Vector3::zeros());
        assert!((motion.specific_force().norm() - STANDARD_GRAVITY).abs() < 1e-12);
    }
    assert!(walk.at(4.0).velocity.norm() > 0.5);
}

#[test]
fn the_route_ends_where_it_was_told_with_the_height_of_the_stair() {
    let walk = walk();
    let end = walk.at(walk.duration_s());
    let expected = Vector3::new(6.0, 9.0 - CARRIED_AHEAD, 1.7 + IMU_HEIGHT);
    assert!((end.world_from_imu.translation.vector - expected).norm() < 1e-9);
    assert_eq!(end.velocity, Vector3::zeros());
}

#[test]
fn a_turn_of_ninety_degrees_keeps_under_its_peak_rate() {
    let walk = walk();
    let peak = (0..3000).map(|k| walk.at(f64::from(k) * 0.01).angular_velocity.z.abs()).fold(0.0, f64::max);
    assert!(peak.to_degrees() > 80.0 && peak.to_degrees() < 95.0, "{}", peak.to_degrees());
}
