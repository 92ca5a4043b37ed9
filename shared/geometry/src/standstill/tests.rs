use super::*;

/// A sensor at rest: 200 Hz, 0.03 m/s^2 and 0.08 deg/s of white noise, 0.3 deg/s of bias, tilted by about 6 degrees.
struct Rig {
    seed: u64,
    time_ns: i64,
    bias: Vector3<f64>,
    gravity: Vector3<f64>,
}

impl Rig {
    fn new(seed: u64) -> Self {
        Self {
            seed,
            time_ns: 0,
            bias: Vector3::new(0.005, -0.003, 0.001),
            gravity: Vector3::new(0.5, -0.8, 9.76),
        }
    }

    fn uniform(&mut self) -> f64 {
        self.seed = self.seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.seed >> 11) as f64 / (1u64 << 53) as f64
    }

    fn noise(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0)
    }

    fn sample(&mut self, rate: Vector3<f64>, acceleration: Vector3<f64>) -> ImuSample {
        self.time_ns += 5_000_000;
        let gyro = rate + self.bias + self.noise() * 0.0014;
        let accel = acceleration + self.gravity + self.noise() * 0.03;
        ImuSample { stamp_ns: self.time_ns, gyro: gyro.into(), accel: accel.into(), ..Default::default() }
    }

    fn rest(&mut self, detector: &mut StandstillDetector, samples: usize) -> MotionState {
        (0..samples).map(|_| detector.push(&self.sample(Vector3::zeros(), Vector3::zeros()))).last().unwrap()
    }

    fn walk(&mut self, detector: &mut StandstillDetector, samples: usize) -> MotionState {
        (0..samples)
            .map(|i| {
                let phase = i as f64 * 0.005 * 1.8 * std::f64::consts::TAU;
                let rate = Vector3::new(0.1, 0.2, 0.15) * phase.sin();
                detector.push(&self.sample(rate, Vector3::new(0.3, 0.5, 1.5) * phase.sin()))
            })
            .last()
            .unwrap()
    }
}

#[test]
fn a_resting_rig_tells_gravity_bias_and_noise() {
    let (mut rig, mut detector) = (Rig::new(1), StandstillDetector::default());
    assert_eq!(rig.rest(&mut detector, 100), MotionState::Collecting);
    assert!(detector.standstill().is_none());
    assert!((detector.rest().unwrap().gyro_bias.unwrap() - rig.bias).norm() < 1e-3, "a first guess");
    assert_eq!(rig.rest(&mut detector, 500), MotionState::Still);
    let still = detector.standstill().unwrap();
    assert!((still.mean_accel - rig.gravity).norm() < 0.006, "{still:?}");
    assert!((still.gyro_bias.unwrap() - rig.bias).norm() < 3e-4, "{still:?}");
    assert!((still.accel_std.mean() / 0.03 - 1.0).abs() < 0.1, "{still:?}");
    assert!((still.gyro_std.unwrap().mean() / 0.0014 - 1.0).abs() < 0.1, "{still:?}");
    assert_eq!(still.end_ns - still.start_ns, (still.samples as i64 - 1) * 5_000_000);
}

#[test]
fn white_noise_is_not_taken_for_motion_within_a_minute_for_nearly_all_seeds() {
    let calm = (0..20)
        .filter(|seed| {
            let (mut rig, mut detector) = (Rig::new(*seed), StandstillDetector::default());
            rig.rest(&mut detector, 12_000);
            detector.standstill().is_some_and(|still| still.start_ns == 5_000_000)
        })
        .count();
    assert!(calm >= 19, "{calm} of 20");
}

#[test]
fn the_last_third_of_a_second_before_a_step_does_not_belong_to_the_standstill() {
    let (mut rig, mut detector) = (Rig::new(2), StandstillDetector::default());
    rig.rest(&mut detector, 400);
    let started_ns = rig.time_ns;
    assert_eq!(rig.walk(&mut detector, 60), MotionState::Moving);
    let still = *detector.standstill().unwrap();
    let margin_ns = started_ns - still.end_ns;
    assert!((200_000_000..=500_000_000).contains(&margin_ns), "{margin_ns}");
    rig.walk(&mut detector, 400);
    assert_eq!(detector.standstill(), Some(&still), "frozen while moving");
}

#[test]
fn a_rig_that_moves_from_the_start_is_said_to_and_its_later_rest_is_found() {
    let (mut rig, mut detector) = (Rig::new(3), StandstillDetector::default());
    assert_eq!(rig.walk(&mut detector, 400), MotionState::Moving);
    assert!(detector.standstill().is_none() && detector.rest().is_none());
    let stopped_ns = rig.time_ns;
    assert_eq!(rig.rest(&mut detector, 300), MotionState::Still);
    let still = detector.standstill().unwrap();
    assert!(still.start_ns > stopped_ns - 100_000_000, "{still:?}");
    assert!((still.gyro_bias.unwrap() - rig.bias).norm() < 5e-4);
}

#[test]
fn a_steady_turn_is_not_a_bias() {
    let (mut rig, mut detector) = (Rig::new(4), StandstillDetector::default());
    for _ in 0..600 {
        detector.push(&rig.sample(Vector3::new(0.0, 0.0, 0.35), Vector3::zeros()));
    }
    assert_eq!((detector.state(), detector.standstill()), (MotionState::Moving, None));
}

#[test]
fn a_gyroscope_held_at_zero_tells_no_bias_and_its_release_is_motion_at_once() {
    let (mut rig, mut detector) = (Rig::new(5), StandstillDetector::default());
    for _ in 0..400 {
        detector.push(&ImuSample { gyro: [0.0; 3], ..rig.sample(Vector3::zeros(), Vector3::zeros()) });
    }
    assert_eq!(detector.state(), MotionState::Still);
    let still = detector.standstill().unwrap();
    assert_eq!((still.gyro_bias, still.gyro_std), (None, None));
    assert!((still.mean_accel - rig.gravity).norm() < 0.01);
    let first = rig.sample(Vector3::new(0.0, 0.0, 0.02), Vector3::zeros());
    assert_eq!(detector.push(&first), MotionState::Moving);
}

#[test]
fn repeated_stale_and_broken_samples_change_nothing() {
    let (mut clean, mut dirty) = (StandstillDetector::default(), StandstillDetector::default());
    let mut rig = Rig::new(6);
    for _ in 0..400 {
        let sample = rig.sample(Vector3::zeros(), Vector3::zeros());
        clean.push(&sample);
        dirty.push(&sample);
        dirty.push(&sample);
        dirty.push(&ImuSample { stamp_ns: sample.stamp_ns - 7_000_000, ..sample });
        dirty.push(&ImuSample { stamp_ns: sample.stamp_ns + 1, gyro: [f64::NAN; 3], ..sample });
    }
    assert!(clean.standstill().is_some());
    assert_eq!(clean.standstill(), dirty.standstill());
}

#[test]
fn what_happened_in_a_gap_was_not_seen_so_the_standstill_starts_again() {
    let (mut rig, mut detector) = (Rig::new(7), StandstillDetector::default());
    rig.rest(&mut detector, 100);
    rig.time_ns += 400_000_000;
    let resumed_ns = rig.time_ns;
    assert_eq!(rig.rest(&mut detector, 300), MotionState::Still);
    assert!(detector.standstill().unwrap().start_ns > resumed_ns);
}
