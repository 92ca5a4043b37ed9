//! Standstill: when the rig rests, and what its IMU then says about gravity, biases and noise.

mod moments;

use evac_frames::ImuSample;
use nalgebra::Vector3;

use moments::Moments;

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
        }
    }

    /// Takes the next sample; one whose stamp is not after the last, or whose values are not finite, is skipped.
    pub fn push(&mut self, sample: &ImuSample) -> MotionState {
        let finite = sample.gyro.iter().chain(&sample.accel).all(|value| value.is_finite());
        if !finite || self.last_stamp_ns.is_some_and(|last| sample.stamp_ns <= last) {
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

#[cfg(test)]
mod tests;
