//! Standstill: when the rig rests, and what its IMU then says about gravity, biases and noise.

use evac_frames::ImuSample;
use nalgebra::Vector3;

/// What counts as standing still. The defaults hold for a WT901C-class sensor at 100 to 1000 Hz.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandstillLimits {
    /// Shortest standstill that is believed, nanoseconds.
    pub min_duration_ns: i64,
    /// Time over which samples are averaged before they are compared, nanoseconds.
    pub block_ns: i64,
    /// Time before the first seen motion that is left out as well: a gait leaks in before it is seen. Nanoseconds.
    pub margin_ns: i64,
    /// Block means may differ from the mean so far by this many standard deviations of their difference (at 3 a resting
    /// rig is taken to move once in three minutes, at 4 once in hours) ...
    pub sigmas: f64,
    /// ... plus this, m/s^2: one step of a 16-bit accelerometer of +-16 g.
    pub accel_tolerance: f64,
    /// ... plus this, rad/s: half a step of a 16-bit gyroscope of +-2000 deg/s.
    pub gyro_tolerance: f64,
    /// Largest standard deviation of a resting accelerometer, m/s^2 per sample.
    pub max_accel_std: f64,
    /// Largest standard deviation of a resting gyroscope, rad/s per sample.
    pub max_gyro_std: f64,
    /// Largest gyroscope bias; a faster steady rate is a turn. rad/s.
    pub max_gyro_bias: f64,
    /// Largest difference between the norm of the mean specific force and standard gravity, m/s^2.
    pub max_gravity_error: f64,
}

impl Default for StandstillLimits {
    fn default() -> Self {
        Self {
            min_duration_ns: 500_000_000,
            block_ns: 100_000_000,
            margin_ns: 300_000_000,
            sigmas: 4.0,
            accel_tolerance: 0.005,
            gyro_tolerance: 0.000_5,
            max_accel_std: 0.2,
            max_gyro_std: 0.02,
            max_gyro_bias: 0.05,
            max_gravity_error: 0.5,
        }
    }
}

/// What the detector knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionState {
    /// No motion seen, but not yet long enough for a standstill either.
    Collecting,
    /// The rig rests; [`StandstillDetector::standstill`] grows.
    Still,
    /// The rig moves. Without a standstill it has done so from the start.
    Moving,
}

/// What the IMU said while the rig stood still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standstill {
    /// Samples averaged.
    pub samples: u64,
    /// Stamp of the first, nanoseconds.
    pub start_ns: i64,
    /// Stamp of the last, nanoseconds.
    pub end_ns: i64,
    /// Mean specific force, m/s^2, IMU frame: it points up.
    pub mean_accel: Vector3<f64>,
    /// Standard deviation per sample and axis, m/s^2.
    pub accel_std: Vector3<f64>,
    /// Mean angular velocity, rad/s, IMU frame. `None` where the gyroscope read exact zeros: its firmware
    /// held the output, which tells nothing about bias or noise.
    pub gyro_bias: Option<Vector3<f64>>,
    /// Standard deviation per sample and axis, rad/s. `None` as above.
    pub gyro_std: Option<Vector3<f64>>,
}

/// Tells from the IMU alone whether the rig stands still. Bounded memory, no allocation after construction.
///
/// Samples are averaged over blocks of 0.1 s. A block that differs from the mean of the standstill so far, or is much
/// noisier, is motion. The last 0.3 s before it are not part of the standstill. A standstill
/// after a motion replaces the one before as soon as it is long enough.
///
/// A constant acceleration or a turn slower than the largest gyroscope bias cannot be told from rest. A rig held in the hand
/// sways and counts as moving.
#[derive(Debug, Clone)]
pub struct StandstillDetector {
    limits: StandstillLimits,
    state: MotionState,
    standstill: Option<Standstill>,
    /// Blocks that the margin has passed.
    settled: Moments,
    /// Younger blocks, oldest first; at most as many as the margin needs.
    pending: Vec<Moments>,
    max_pending: usize,
    block: Moments,
    last_stamp_ns: Option<i64>,
    zero_run: u32,
    held_at_zero: bool,
    skipped: u64,
}

/// A gyroscope with noise cannot read zero on three axes this often in a row.
const HELD_RUN: u32 = 10;
/// Fewer samples say too little about their scatter.
const MIN_BLOCK_SAMPLES: u64 = 5;
/// Blocks whose scatter differs by more than this factor were not measured in the same state.
const SCATTER_RATIO: f64 = 2.0;

impl StandstillDetector {
    /// A detector that has seen nothing.
    pub fn new(limits: StandstillLimits) -> Self {
        let blocks = limits.margin_ns.max(0) / limits.block_ns.max(1);
        let max_pending = usize::try_from(blocks).unwrap_or(0).min(1000);
        Self {
            limits,
            state: MotionState::Collecting,
            standstill: None,
            settled: Moments::default(),
            pending: Vec::with_capacity(max_pending + 1),
            max_pending,
            block: Moments::default(),
            last_stamp_ns: None,
            zero_run: 0,
            held_at_zero: false,
            skipped: 0,
        }
    }

    /// Takes the next sample; one whose stamp is not after the last, or whose values are not finite, is skipped.
    pub fn push(&mut self, sample: &ImuSample) -> MotionState {
        let finite = sample.gyro.iter().chain(&sample.accel).all(|value| value.is_finite());
        if !finite || self.last_stamp_ns.is_some_and(|last| sample.stamp_ns <= last) {
            self.skipped += 1;
            return self.state;
        }
        // Whatever happened in a gap of a whole block was not seen.
        let gap = self
            .last_stamp_ns
            .is_some_and(|last| sample.stamp_ns.saturating_sub(last) > self.limits.block_ns);
        self.last_stamp_ns = Some(sample.stamp_ns);
        if gap {
            self.restart(if self.state == MotionState::Collecting {
                self.state
            } else {
                MotionState::Moving
            });
        }
        let released = self.watch_held_gyro(sample);
        if released {
            self.restart(MotionState::Moving);
        }
        let full = self.block.samples >= MIN_BLOCK_SAMPLES
            && sample.stamp_ns.saturating_sub(self.block.start_ns) >= self.limits.block_ns;
        if full {
            self.close_block();
        }
        self.block.add(sample);
        self.state
    }

    /// What is known now.
    pub fn state(&self) -> MotionState {
        self.state
    }

    /// The standstill that lasts, or the last one that was long enough.
    pub fn standstill(&self) -> Option<&Standstill> {
        self.standstill.as_ref()
    }

    /// The rest that lasts: the standstill, or before one is long enough what was measured so far without seeing motion.
    /// `None` while the rig moves and before the first block is full.
    pub fn rest(&self) -> Option<Standstill> {
        match self.state {
            MotionState::Moving => None,
            MotionState::Still => self.standstill,
            MotionState::Collecting => self.reference().map(|rest| rest.standstill(self.held_at_zero)),
        }
    }

    /// Whether motion was seen before any standstill: gravity and biases are then unknown.
    pub fn started_moving(&self) -> bool {
        self.state == MotionState::Moving && self.standstill.is_none()
    }

    /// Samples skipped: out of order, twice the same stamp, or not finite.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    fn close_block(&mut self) {
        let block = std::mem::take(&mut self.block);
        if !self.at_rest(&block) {
            self.restart(MotionState::Moving);
            return;
        }
        if let Some(reference) = self.reference() {
            match self.compare(&reference, &block) {
                Comparison::Same => {}
                Comparison::Different => {
                    self.restart(MotionState::Moving);
                    return;
                }
                // What was taken for rest was the end of a motion; this block starts a new standstill.
                Comparison::Quieter => self.restart(MotionState::Moving),
            }
        }
        self.pending.push(block);
        if self.pending.len() > self.max_pending {
            let oldest = self.pending.remove(0);
            self.settled.merge(&oldest);
        }
        if self.settled.samples > 0
            && self.settled.end_ns - self.settled.start_ns + self.limits.block_ns / 2
                >= self.limits.min_duration_ns
        {
            self.state = MotionState::Still;
            self.standstill = Some(self.settled.standstill(self.held_at_zero));
        }
    }

    fn reference(&self) -> Option<Moments> {
        if self.settled.samples > 0 {
            return Some(self.settled);
        }
        let (first, rest) = self.pending.split_first()?;
        let mut all = *first;
        rest.iter().for_each(|block| all.merge(block));
        Some(all)
    }

    fn restart(&mut self, state: MotionState) {
        self.state = state;
        self.settled = Moments::default();
        self.pending.clear();
        self.block = Moments::default();
        self.held_at_zero = self.zero_run >= HELD_RUN;
    }

    /// Whether the gyroscope was held at zero by its firmware and has just been let go: that is motion, at once.
    fn watch_held_gyro(&mut self, sample: &ImuSample) -> bool {
        if sample.gyro == [0.0; 3] {
            self.zero_run = self.zero_run.saturating_add(1);
            self.held_at_zero |= self.zero_run >= HELD_RUN;
            return false;
        }
        let was_held = self.zero_run >= HELD_RUN;
        self.zero_run = 0;
        was_held && Vector3::from(sample.gyro).amax() > 2.0 * self.limits.gyro_tolerance
    }

    fn at_rest(&self, block: &Moments) -> bool {
        let limits = &self.limits;
        let gravity_error = block.mean_accel().norm() - crate::STANDARD_GRAVITY;
        block.mean_gyro().amax() <= limits.max_gyro_bias
            && gravity_error.abs() <= limits.max_gravity_error
            && block.accel_variance().amax().sqrt() <= limits.max_accel_std
            && block.gyro_variance().amax().sqrt() <= limits.max_gyro_std
    }

    fn compare(&self, reference: &Moments, block: &Moments) -> Comparison {
        let limits = &self.limits;
        // The axes of one sensor have one noise: their mean variance is three times as certain.
        let (accel, gyro) = (reference.accel_variance().mean(), reference.gyro_variance().mean());
        let weight = 1.0 / block.samples as f64 + 1.0 / reference.samples as f64;
        let accel_limit = limits.sigmas * (accel * weight).sqrt() + limits.accel_tolerance;
        let gyro_limit = limits.sigmas * (gyro * weight).sqrt() + limits.gyro_tolerance;
        // While the firmware holds the gyroscope, or starts to, its mean says nothing.
        let turned = !self.held_at_zero && (block.mean_gyro() - reference.mean_gyro()).amax() > gyro_limit;
        let tilted = (block.mean_accel() - reference.mean_accel()).amax() > accel_limit;
        let accel_scatter = scatter(block.accel_variance().mean(), accel, limits.accel_tolerance);
        let gyro_scatter = if self.held_at_zero {
            Comparison::Same
        } else {
            scatter(block.gyro_variance().mean(), gyro, limits.gyro_tolerance)
        };
        let scatters = [accel_scatter, gyro_scatter];
        if scatters.contains(&Comparison::Quieter) {
            Comparison::Quieter
        } else if turned || tilted || scatters.contains(&Comparison::Different) {
            Comparison::Different
        } else {
            Comparison::Same
        }
    }
}

impl Default for StandstillDetector {
    fn default() -> Self {
        Self::new(StandstillLimits::default())
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Comparison {
    Same,
    Different,
    Quieter,
}

/// Compares variances; `tolerance` keeps a sensor whose noise is below its step from looking restless.
fn scatter(block: f64, reference: f64, tolerance: f64) -> Comparison {
    let (block, reference) = (block.sqrt(), reference.sqrt());
    if block > SCATTER_RATIO * reference + tolerance {
        Comparison::Different
    } else if reference > SCATTER_RATIO * block + tolerance {
        Comparison::Quieter
    } else {
        Comparison::Same
    }
}

/// Sums over samples. Gravity is about 10 m/s^2 and the noise 0.01: in `f64` the difference of squares is good to 1e-10.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    samples: u64,
    start_ns: i64,
    end_ns: i64,
    accel: Vector3<f64>,
    accel_squared: Vector3<f64>,
    gyro: Vector3<f64>,
    gyro_squared: Vector3<f64>,
}

impl Moments {
    fn add(&mut self, sample: &ImuSample) {
        let (gyro, accel) = (Vector3::from(sample.gyro), Vector3::from(sample.accel));
        self.merge(&Self {
            samples: 1,
            start_ns: sample.stamp_ns,
            end_ns: sample.stamp_ns,
            accel,
            accel_squared: accel.component_mul(&accel),
            gyro,
            gyro_squared: gyro.component_mul(&gyro),
        });
    }

    /// Adds what was measured after this.
    fn merge(&mut self, later: &Self) {
        if self.samples == 0 {
            *self = *later;
            return;
        }
        self.samples += later.samples;
        self.end_ns = later.end_ns;
        self.accel += later.accel;
        self.accel_squared += later.accel_squared;
        self.gyro += later.gyro;
        self.gyro_squared += later.gyro_squared;
    }

    fn mean_accel(&self) -> Vector3<f64> {
        self.accel / self.samples.max(1) as f64
    }

    fn mean_gyro(&self) -> Vector3<f64> {
        self.gyro / self.samples.max(1) as f64
    }

    fn accel_variance(&self) -> Vector3<f64> {
        variance(self.samples, &self.accel, &self.accel_squared)
    }

    fn gyro_variance(&self) -> Vector3<f64> {
        variance(self.samples, &self.gyro, &self.gyro_squared)
    }

    fn standstill(&self, held_at_zero: bool) -> Standstill {
        Standstill {
            samples: self.samples,
            start_ns: self.start_ns,
            end_ns: self.end_ns,
            mean_accel: self.mean_accel(),
            accel_std: self.accel_variance().map(f64::sqrt),
            gyro_bias: (!held_at_zero).then(|| self.mean_gyro()),
            gyro_std: (!held_at_zero).then(|| self.gyro_variance().map(f64::sqrt)),
        }
    }
}

/// Unbiased variance from sums; never negative.
fn variance(samples: u64, sum: &Vector3<f64>, squared: &Vector3<f64>) -> Vector3<f64> {
    let n = samples as f64;
    let freedom = (n - 1.0).max(1.0);
    sum.zip_map(squared, |sum, squared| ((squared - sum * sum / n.max(1.0)) / freedom).max(0.0))
}

#[cfg(test)]
mod tests {
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
            self.seed =
                self.seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
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
            (0..samples)
                .map(|_| detector.push(&self.sample(Vector3::zeros(), Vector3::zeros())))
                .last()
                .unwrap()
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
        assert!(detector.started_moving() && detector.standstill().is_none() && detector.rest().is_none());
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
        assert!(detector.started_moving());
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
    fn repeated_stale_and_broken_samples_change_nothing_and_are_counted() {
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
        assert_eq!(clean.standstill(), dirty.standstill());
        assert_eq!((clean.skipped(), dirty.skipped()), (0, 1200));
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
}
