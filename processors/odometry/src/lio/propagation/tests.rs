use evac_geometry::STANDARD_GRAVITY;

use super::super::state::Error;

use super::*;

fn readings(gyro: Vector3<f64>, accel: Vector3<f64>, held: bool) -> Vec<Reading> {
    (0..=200).map(|k| Reading { stamp_ns: k * 5_000_000, gyro, accel, held }).collect()
}

fn run(state: &mut State, readings: &[Reading]) -> (Covariance, u64) {
    let mut covariance = Covariance::zeros();
    let noise = Noise::new(&LioConfig::default(), 1.0, false, false, 0.0);
    // Has long gone on like that.
    let mut habit = Habit::default();
    habit.take(100.0, &state.velocity, &Vector3::zeros());
    let mut trace = Vec::with_capacity(512);
    let span = (0, 1_000_000_000);
    let gaps = propagate(state, &mut covariance, readings, span, &habit, &noise, &mut trace);
    (covariance, gaps.gaps)
}

#[test]
fn a_second_of_steady_acceleration_and_turn_ends_where_it_must() {
    let mut state = State::at_origin();
    state.gyro_bias = Vector3::new(0.0, 0.0, 0.1);
    let up = Vector3::new(0.0, 0.0, STANDARD_GRAVITY);
    run(&mut state, &readings(Vector3::new(0.0, 0.0, 0.6), up + Vector3::new(0.0, 0.0, 2.0), false));
    assert!((state.position - Vector3::new(0.0, 0.0, 1.0)).norm() < 1e-9);
    assert!((state.velocity - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-9);
    assert!((state.rotation.scaled_axis() - Vector3::new(0.0, 0.0, 0.5)).norm() < 1e-9);
}

#[test]
fn a_gyroscope_held_at_zero_does_not_turn_the_state_by_its_bias() {
    let mut state = State::at_origin();
    state.gyro_bias = Vector3::new(0.0, 0.0, 0.01);
    let up = Vector3::new(0.0, 0.0, STANDARD_GRAVITY);
    let (covariance, _) = run(&mut state, &readings(Vector3::zeros(), up, true));
    assert_eq!(state.rotation.angle(), 0.0);
    // The hidden rate counts as noise: 0.03 rad/s per sample over a second.
    assert!((covariance[(2, 2)].sqrt() - 0.03 * 0.005_f64.sqrt()).abs() < 1e-5);
}

#[test]
fn without_readings_the_motion_goes_on_and_the_uncertainty_says_so() {
    let mut state = State::at_origin();
    state.velocity = Vector3::new(1.0, 0.0, 0.0);
    let (blind, gaps) = run(&mut state, &[]);
    assert_eq!(gaps, 1);
    assert!((state.position - Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-9);
    let mut other = State::at_origin();
    let up = Vector3::new(0.0, 0.0, STANDARD_GRAVITY);
    let (seen, _) = run(&mut other, &readings(Vector3::zeros(), up, false));
    assert!(blind[(7, 7)] > 100.0 * seen[(7, 7)] && blind[(0, 0)] > 100.0 * seen[(0, 0)]);
}

#[test]
fn a_walker_is_followed_blindly_at_the_mean_speed_and_learns_nothing_of_gravity_by_it() {
    // The IMU falls silent on the way up, in the middle of a step.
    let mut state = State { velocity: Vector3::new(1.3, 0.0, 0.4), ..State::at_origin() };
    let mut habit = Habit::default();
    for frame in 0..60 {
        let up = if frame % 4 < 2 { 0.4 } else { -0.4 };
        habit.take(0.1, &Vector3::new(1.3, 0.0, up), &Vector3::zeros());
    }
    let mut covariance = Covariance::identity() * 1e-4;
    let (gravity, bias) =
        (covariance[(at::GRAVITY, at::GRAVITY)], covariance[(at::ACCEL_BIAS, at::ACCEL_BIAS)]);
    let noise = Noise::new(&LioConfig::default(), 1.0, false, false, 0.0);
    let span = (0, 500_000_000);
    propagate(&mut state, &mut covariance, &[], span, &habit, &noise, &mut Vec::with_capacity(64));
    assert!((state.velocity - Vector3::new(1.3, 0.0, 0.0)).norm() < 0.15, "{}", state.velocity);
    assert!((state.position.x - 0.65).abs() < 0.02 && state.position.z.abs() < 0.1, "{}", state.position);
    let sigma = [0, 1, 2].map(|axis| covariance[(at::VELOCITY + axis, at::VELOCITY + axis)].sqrt());
    assert!(sigma[0] < 0.25 && sigma[2] > 0.35, "{sigma:?}");
    for index in at::ROTATION..at::GYRO_BIAS {
        assert_eq!(covariance[(index, at::GRAVITY + 1)], 0.0);
        assert_eq!(covariance[(index, at::ACCEL_BIAS + 1)], 0.0);
    }
    assert_eq!(covariance[(at::GRAVITY, at::GRAVITY)], gravity);
    assert!(covariance[(at::ACCEL_BIAS, at::ACCEL_BIAS)] < bias + 1e-6);
}

#[test]
fn a_sample_missing_for_sixty_milliseconds_is_one_gap() {
    let up = Vector3::new(0.0, 0.0, STANDARD_GRAVITY);
    let mut readings = readings(Vector3::zeros(), up, false);
    readings.retain(|reading| !(300_000_000..360_000_000).contains(&reading.stamp_ns));
    assert_eq!(run(&mut State::at_origin(), &readings).1, 1);
}

/// A walking, turning state with every error that it can have.
fn in_motion() -> State {
    State {
        rotation: exp_so3(&Vector3::new(0.3, -0.2, 1.1)),
        velocity: Vector3::new(1.0, -0.4, 0.1),
        gyro_bias: Vector3::new(0.01, -0.02, 0.015),
        accel_bias: Vector3::new(0.05, 0.02, -0.04),
        gyro_scale: Vector3::new(0.004, -0.003, 0.005),
        misalignment: Vector3::new(0.02, -0.01, 0.015),
        ..State::at_origin()
    }
}

#[test]
fn the_covariance_moves_as_the_states_around_it_do() {
    let up = in_motion().rotation.inverse() * Vector3::new(0.5, 0.2, STANDARD_GRAVITY + 0.3);
    let readings = readings(Vector3::new(0.2, -0.3, 1.4), up, false);
    let readings = &readings[..3];
    let silent =
        Noise { gyro: 0.0, held_gyro: 0.0, accel: 0.0, gyro_walk: 0.0, accel_walk: 0.0, offset_walk: 0.0 };
    let moved = |d: &Error, covariance: &mut Covariance| {
        let mut state = in_motion();
        // Gravity is perturbed without the norm that `plus` holds it to.
        let gravity = state.gravity + d.fixed_rows::<3>(at::GRAVITY);
        state = state.plus(d);
        state.gravity = gravity;
        let mut trace = Vec::with_capacity(8);
        propagate(&mut state, covariance, readings, (0, 10_000_000), &Habit::default(), &silent, &mut trace);
        state
    };
    let mut covariance = Covariance::identity();
    let centre = moved(&Error::zeros(), &mut covariance);
    let epsilon = 1e-5;
    let mut transition = Covariance::identity();
    for i in 0..DIM {
        let mut d = Error::zeros();
        d[i] = epsilon;
        let [above, below] = [d, -d].map(|d| moved(&d, &mut Covariance::zeros()));
        let turn = |state: &State| log_so3(&(centre.rotation.inverse() * state.rotation));
        let mut column = |row: usize, difference: Vector3<f64>| {
            transition.fixed_view_mut::<3, 1>(row, i).copy_from(&(difference / (2.0 * epsilon)));
        };
        column(at::ROTATION, turn(&above) - turn(&below));
        column(at::POSITION, above.position - below.position);
        column(at::VELOCITY, above.velocity - below.velocity);
    }
    let expected = transition * transition.transpose();
    let off = (covariance - expected).abs().max();
    // First order in a step of 5 ms: 1 % of the largest entry, gravity over 10 ms.
    assert!(off < 2e-3, "{off}");
}
