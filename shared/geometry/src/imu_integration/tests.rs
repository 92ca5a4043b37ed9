use super::*;
use crate::{STANDARD_GRAVITY, log_so3};

const UP: Vector3<f64> = Vector3::new(0.0, 0.0, STANDARD_GRAVITY);

fn start(velocity: Vector3<f64>) -> ImuState {
    ImuState {
        time_ns: 0,
        world_from_imu: UnitQuaternion::identity(),
        position: Vector3::zeros(),
        velocity,
        gyro_bias: Vector3::zeros(),
        accel_bias: Vector3::zeros(),
        gravity: -UP,
        time_offset_ns: 0,
    }
}

/// The truth: a circle of 1 m radius at `rate(t)` about z, heading along the tangent.
fn on_circle(stamp_ns: i64) -> ImuSample {
    let (_, rate, change) = circle(stamp_ns);
    // In the body frame x is the tangent and y points to the centre.
    let accel = [change, rate * rate, STANDARD_GRAVITY];
    ImuSample { stamp_ns, gyro: [0.0, 0.0, rate], accel, ..Default::default() }
}

fn circle(stamp_ns: i64) -> (f64, f64, f64) {
    let t = seconds(stamp_ns);
    (1.5 * t + 0.2 * (1.0 - (5.0 * t).cos()), 1.5 + (5.0 * t).sin(), 5.0 * (5.0 * t).cos())
}

fn circle_pose(stamp_ns: i64) -> Isometry3<f64> {
    let angle = circle(stamp_ns).0;
    Isometry3::new(Vector3::new(angle.sin(), 1.0 - angle.cos(), 0.0), Vector3::z() * angle)
}

fn samples(from_ns: i64, to_ns: i64, period_ns: i64) -> Vec<ImuSample> {
    (0..=(to_ns - from_ns) / period_ns).map(|i| on_circle(from_ns + i * period_ns)).collect()
}

#[test]
fn a_second_on_a_circle_ends_within_a_millimetre_of_it_and_every_time_between_is_as_good() {
    let mut integrator = ImuIntegrator::new(512);
    // Neither border falls on a sample.
    let coverage = integrator.integrate(
        &start(Vector3::new(1.5, 0.0, 0.0)),
        &samples(-2_000_000, 1_003_000_000, 5_000_000),
        1_000_000_000,
    );
    assert_eq!((coverage.used, coverage.gaps, coverage.skipped), (202, 0, 0));
    assert_eq!((coverage.uncovered_start_ns, coverage.uncovered_end_ns), (0, 0));
    for step in 0..=1000 {
        let time_ns = step * 1_000_000;
        let error = circle_pose(time_ns).inverse() * integrator.pose_at(time_ns);
        assert!(error.translation.vector.norm() < 1e-3, "{step} ms: {error}");
        assert!(log_so3(&error.rotation).norm() < 1e-4, "{step} ms: {error}");
    }
}

#[test]
fn at_its_knots_the_lookup_is_the_integral() {
    let mut integrator = ImuIntegrator::new(64);
    integrator.integrate(&start(Vector3::x()), &samples(0, 100_000_000, 5_000_000), 98_000_000);
    assert_eq!(integrator.knots.len(), 21);
    for pair in integrator.knots.windows(2) {
        let almost = integrator.pose_at(pair[1].time_ns - 1);
        let knot = Isometry3::from_parts(pair[1].position.into(), pair[1].world_from_imu);
        let error = knot.inverse() * almost;
        assert!(error.translation.vector.norm() < 1e-8 && log_so3(&error.rotation).norm() < 1e-8);
    }
    assert_eq!(integrator.knots.last().unwrap().time_ns, 98_000_000);
}

#[test]
fn biases_are_subtracted_and_the_time_offset_is_added_to_stamps() {
    let mut integrator = ImuIntegrator::new(64);
    let (gyro_bias, accel_bias) = (Vector3::new(0.01, -0.02, 0.005), Vector3::new(0.1, 0.05, -0.03));
    let shifted: Vec<_> = samples(-5_000_000, 105_000_000, 5_000_000)
        .iter()
        .map(|sample| ImuSample {
            stamp_ns: sample.stamp_ns - 7_000_000,
            gyro: (Vector3::from(sample.gyro) + gyro_bias).into(),
            accel: (Vector3::from(sample.accel) + accel_bias).into(),
            ..*sample
        })
        .collect();
    let start =
        ImuState { gyro_bias, accel_bias, time_offset_ns: 7_000_000, ..start(Vector3::new(1.5, 0.0, 0.0)) };
    integrator.integrate(&start, &shifted, 100_000_000);
    let error = circle_pose(100_000_000).inverse() * integrator.pose_at(100_000_000);
    assert!(error.translation.vector.norm() < 1e-4 && log_so3(&error.rotation).norm() < 1e-4, "{error}");
}

#[test]
fn repeated_stale_and_broken_samples_are_skipped_and_change_nothing() {
    let mut integrator = ImuIntegrator::new(64);
    let clean = samples(-5_000_000, 105_000_000, 5_000_000);
    let start = start(Vector3::x());
    integrator.integrate(&start, &clean, 100_000_000);
    let expected = integrator.pose_at(100_000_000);
    let mut dirty = Vec::new();
    for sample in &clean {
        let early = ImuSample { stamp_ns: sample.stamp_ns - 12_000_000, ..*sample };
        let broken = ImuSample { stamp_ns: sample.stamp_ns + 1, accel: [f64::INFINITY; 3], ..*sample };
        let absurd = ImuSample { stamp_ns: sample.stamp_ns + 1, gyro: [1e300; 3], ..*sample };
        dirty.extend([*sample, *sample, broken, absurd]);
        if sample.stamp_ns > 0 {
            dirty.push(early);
        }
    }
    let coverage = integrator.integrate(&start, &dirty, 100_000_000);
    assert_eq!(integrator.pose_at(100_000_000), expected);
    assert!(coverage.skipped >= 80, "{coverage:?}");
}

#[test]
fn a_gap_is_bridged_and_told() {
    let mut integrator = ImuIntegrator::new(64);
    let mut broken = samples(0, 100_000_000, 5_000_000);
    broken.retain(|sample| !(30_000_000..65_000_000).contains(&sample.stamp_ns));
    let coverage = integrator.integrate(&start(Vector3::new(1.5, 0.0, 0.0)), &broken, 100_000_000);
    assert_eq!((coverage.gaps, coverage.longest_interval_ns), (1, 40_000_000));
    let error = circle_pose(100_000_000).inverse() * integrator.pose_at(100_000_000);
    assert!(log_so3(&error.rotation).norm() < 2e-3, "{error}");
}

#[test]
fn a_slower_sensor_is_learnt_and_is_not_a_row_of_gaps() {
    let mut integrator = ImuIntegrator::new(512);
    let slow = samples(0, 1_000_000_000, 20_000_000);
    integrator.integrate(&start(Vector3::zeros()), &slow, 1_000_000_000);
    let coverage = integrator.integrate(&start(Vector3::zeros()), &slow, 1_000_000_000);
    assert_eq!(coverage.gaps, 0);
    assert!((integrator.period_ns / 20e6 - 1.0).abs() < 0.05);
}

#[test]
fn where_samples_are_missing_at_the_borders_their_neighbours_are_held_and_it_is_told() {
    let mut integrator = ImuIntegrator::new(64);
    let turn =
        |stamp_ns| ImuSample { stamp_ns, gyro: [0.0, 0.0, 1.0], accel: UP.into(), ..Default::default() };
    let coverage =
        integrator.integrate(&start(Vector3::zeros()), &[turn(20_000_000), turn(30_000_000)], 100_000_000);
    assert_eq!((coverage.uncovered_start_ns, coverage.uncovered_end_ns), (20_000_000, 70_000_000));
    assert!((log_so3(&integrator.pose_at(100_000_000).rotation).z - 0.1).abs() < 1e-9);
    // No sample at all: the rig coasts.
    let coverage = integrator.integrate(&start(Vector3::x()), &[], 100_000_000);
    assert_eq!((coverage.used, coverage.uncovered_end_ns), (0, 100_000_000));
    let error = Isometry3::translation(0.1, 0.0, 0.0).inverse() * integrator.pose_at(100_000_000);
    assert!(error.translation.vector.norm() < 1e-12 && log_so3(&error.rotation).norm() < 1e-12);
}

#[test]
fn more_samples_than_room_are_counted_and_the_end_is_still_reached() {
    let mut integrator = ImuIntegrator::new(8);
    let start = start(Vector3::zeros());
    for last_ns in [80_000_000, 100_000_000] {
        let samples = samples(0, last_ns, 5_000_000);
        let coverage = integrator.integrate(&start, &samples, 100_000_000);
        assert!(coverage.skipped > 0 && integrator.knots.len() <= 10);
        let end = integrator.knots.last().unwrap();
        assert_eq!((end.time_ns, coverage.uncovered_end_ns), (100_000_000, 100_000_000 - last_ns));
        // The last sample's rate, not that of the last one for which there was room.
        assert!((end.angular_velocity.z - circle(last_ns).1).abs() < 1e-12);
    }
    assert_eq!(integrator.end_state(&start).time_ns, 100_000_000);
}
