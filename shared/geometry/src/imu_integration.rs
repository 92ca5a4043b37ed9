//! Integration of IMU samples (paper Eq. 4-5 and Algorithm 1, steps 6-7): from a start state to the IMU's pose at any
//! time inside a frame.

use evac_frames::ImuSample;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::exp_so3;

/// Where the integration starts. The world is any frame in which gravity is known, the map for one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuState {
    /// Time at which the state holds, nanoseconds of the scans' time base.
    pub time_ns: i64,
    /// Orientation of the IMU in the world.
    pub world_from_imu: UnitQuaternion<f64>,
    /// Position of the IMU in the world, metres.
    pub position: Vector3<f64>,
    /// Velocity of the IMU in the world, m/s.
    pub velocity: Vector3<f64>,
    /// Subtracted from the measured angular velocity, rad/s, IMU frame.
    pub gyro_bias: Vector3<f64>,
    /// Subtracted from the measured specific force, m/s^2, IMU frame.
    pub accel_bias: Vector3<f64>,
    /// Gravity in the world, m/s^2 (points down).
    pub gravity: Vector3<f64>,
    /// Added to the samples' stamps, nanoseconds.
    pub time_offset_ns: i64,
}

/// The IMU's motion at one instant: position and velocity in the world, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Knot {
    /// Nanoseconds of the scans' time base (the time offset is applied).
    time_ns: i64,
    world_from_imu: UnitQuaternion<f64>,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    /// Angular velocity without bias, rad/s, IMU frame.
    angular_velocity: Vector3<f64>,
    /// Acceleration without bias and gravity, m/s^2, world frame.
    acceleration: Vector3<f64>,
}

/// How well the samples covered the integrated interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ImuCoverage {
    /// Samples that the integral rests on, those just outside its borders included.
    pub used: usize,
    /// Samples left out: stamp not after the one before, a value not finite or beyond any sensor's range, or no room.
    pub skipped: usize,
    /// Intervals of more than two sample periods, bridged by a straight line between the samples at their ends.
    pub gaps: usize,
    /// Longest interval between two samples that the integral spans, nanoseconds.
    pub longest_interval_ns: i64,
    /// Time between the start and the first sample where none came before it; the first sample's values were held.
    pub uncovered_start_ns: i64,
    /// Time between the last sample and the end where none came after it; the last sample's values were held.
    pub uncovered_end_ns: i64,
}

/// Integrates IMU samples by the trapezoidal rule and answers where the IMU was at any time between.
///
/// Buffers are allocated at construction only. The error of an interval of `h` seconds under the angular jerk `j` is
/// about `j h^3 / 12` radians: 1e-6 for a walking person at 200 Hz.
#[derive(Debug, Clone)]
pub struct ImuIntegrator {
    /// The start, each used sample and the end, in order of time; empty before the first integration.
    knots: Vec<Knot>,
    capacity: usize,
    /// Running estimate of the sample period, by which gaps are told.
    period_ns: f64,
}

#[derive(Debug, Clone, Copy)]
struct Reading {
    time_ns: i64,
    gyro: Vector3<f64>,
    accel: Vector3<f64>,
}

/// No MEMS sensor reaches these; what is beyond is a transmission error and would only overflow the integral.
const MAX_RATE: f64 = 100.0;
const MAX_ACCELERATION: f64 = 1000.0;

impl ImuIntegrator {
    /// Room for integrals over at most `capacity` samples.
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity.max(1) + 2;
        Self { knots: Vec::with_capacity(capacity), capacity, period_ns: 5e6 }
    }

    /// Integrates from `start` to `end_ns`, forgetting what was there before. The samples should reach from one at or before
    /// the start to one at or after the end; the values at both borders are interpolated, or held where
    /// a sample is missing (see [`ImuCoverage`]). With an `end_ns` not after the start nothing is integrated.
    pub fn integrate(&mut self, start: &ImuState, samples: &[ImuSample], end_ns: i64) -> ImuCoverage {
        self.knots.clear();
        let mut coverage = ImuCoverage::default();
        let mut previous: Option<Reading> = None;
        for sample in samples {
            let Some(reading) = reading(sample, start.time_offset_ns) else {
                coverage.skipped += 1;
                continue;
            };
            if previous.is_some_and(|p| reading.time_ns <= p.time_ns) {
                coverage.skipped += 1;
                continue;
            }
            if reading.time_ns > start.time_ns {
                let from = previous.unwrap_or(Reading { time_ns: start.time_ns, ..reading });
                match previous {
                    Some(p) => self.judge_interval(reading.time_ns.saturating_sub(p.time_ns), &mut coverage),
                    None => {
                        coverage.uncovered_start_ns =
                            reading.time_ns.min(end_ns).saturating_sub(start.time_ns).max(0)
                    }
                }
                if self.knots.is_empty() {
                    coverage.used += usize::from(previous.is_some());
                    self.begin(start, &between(&from, &reading, start.time_ns));
                }
                coverage.used += 1;
                if reading.time_ns >= end_ns {
                    self.step(start, &between(&from, &reading, end_ns));
                    return coverage;
                }
                if self.knots.len() + 1 < self.capacity {
                    self.step(start, &reading);
                } else {
                    coverage.skipped += 1;
                }
            }
            previous = Some(reading);
        }
        self.hold(start, previous, end_ns, &mut coverage);
        coverage
    }

    /// The state at the end, from which the next integral goes on; `start` is the one this integral began with.
    pub fn end_state(&self, start: &ImuState) -> ImuState {
        self.knots.last().map_or(*start, |knot| ImuState {
            time_ns: knot.time_ns,
            world_from_imu: knot.world_from_imu,
            position: knot.position,
            velocity: knot.velocity,
            ..*start
        })
    }

    /// Pose of the IMU in the world at `time_ns`: angular velocity linear, acceleration constant between two knots;
    /// outside the integral the motion at its border goes on. The identity before the first integration.
    pub fn pose_at(&self, time_ns: i64) -> Isometry3<f64> {
        let after = self.knots.partition_point(|knot| knot.time_ns <= time_ns);
        let Some(from) = self.knots.get(after.saturating_sub(1)) else {
            return Isometry3::identity();
        };
        let d = seconds(time_ns.saturating_sub(from.time_ns));
        let (turn, acceleration) = match self.knots.get(after) {
            Some(to) if after > 0 => {
                let h = seconds(to.time_ns.saturating_sub(from.time_ns));
                let change = to.angular_velocity - from.angular_velocity;
                let turn = from.angular_velocity * d + change * (d * d / (2.0 * h));
                (turn, (from.acceleration + to.acceleration) / 2.0)
            }
            _ => (from.angular_velocity * d, from.acceleration),
        };
        Isometry3::from_parts(
            Translation3::from(from.position + from.velocity * d + acceleration * (d * d / 2.0)),
            from.world_from_imu * exp_so3(&turn),
        )
    }

    fn begin(&mut self, start: &ImuState, reading: &Reading) {
        self.knots.push(Knot {
            time_ns: start.time_ns,
            world_from_imu: start.world_from_imu,
            position: start.position,
            velocity: start.velocity,
            angular_velocity: reading.gyro - start.gyro_bias,
            acceleration: start.world_from_imu * (reading.accel - start.accel_bias) + start.gravity,
        });
    }

    /// Paper Eq. 4 for all three axes at once, on the rotation group; Eq. 5 is its repetition.
    fn step(&mut self, start: &ImuState, reading: &Reading) {
        let Some(from) = self.knots.last().filter(|from| from.time_ns < reading.time_ns) else {
            return;
        };
        let h = seconds(reading.time_ns.saturating_sub(from.time_ns));
        let angular_velocity = reading.gyro - start.gyro_bias;
        let turn = (from.angular_velocity + angular_velocity) * (h / 2.0);
        let mut world_from_imu = from.world_from_imu * exp_so3(&turn);
        world_from_imu.renormalize_fast();
        let acceleration = world_from_imu * (reading.accel - start.accel_bias) + start.gravity;
        let mean = (from.acceleration + acceleration) / 2.0;
        self.knots.push(Knot {
            time_ns: reading.time_ns,
            world_from_imu,
            position: from.position + from.velocity * h + mean * (h * h / 2.0),
            velocity: from.velocity + mean * h,
            angular_velocity,
            acceleration,
        });
    }

    /// Goes on to the end where no sample came after it. Without any sample the rig coasts: no turn, no acceleration.
    fn hold(&mut self, start: &ImuState, last: Option<Reading>, end_ns: i64, coverage: &mut ImuCoverage) {
        let held = last.unwrap_or_else(|| Reading {
            time_ns: start.time_ns,
            gyro: start.gyro_bias,
            accel: start.accel_bias - start.world_from_imu.inverse() * start.gravity,
        });
        if self.knots.is_empty() {
            coverage.used += usize::from(last.is_some());
            self.begin(start, &held);
        }
        coverage.uncovered_end_ns = end_ns.saturating_sub(held.time_ns).max(0);
        self.step(start, &Reading { time_ns: end_ns, ..held });
    }

    fn judge_interval(&mut self, interval_ns: i64, coverage: &mut ImuCoverage) {
        let interval = interval_ns as f64;
        if interval > 2.0 * self.period_ns {
            coverage.gaps += 1;
        }
        coverage.longest_interval_ns = coverage.longest_interval_ns.max(interval_ns);
        // Clipped, so that a gap hardly moves the estimate and yet a slower sensor is learnt within a few samples.
        self.period_ns += (interval.min(2.0 * self.period_ns) - self.period_ns) / 16.0;
        self.period_ns = self.period_ns.max(1e5);
    }
}

fn reading(sample: &ImuSample, time_offset_ns: i64) -> Option<Reading> {
    let (gyro, accel) = (Vector3::from(sample.gyro), Vector3::from(sample.accel));
    // Comparisons with NaN are false.
    let plausible = gyro.norm() <= MAX_RATE && accel.norm() <= MAX_ACCELERATION;
    plausible.then_some(Reading { time_ns: sample.stamp_ns.saturating_add(time_offset_ns), gyro, accel })
}

fn between(a: &Reading, b: &Reading, time_ns: i64) -> Reading {
    let span = b.time_ns.saturating_sub(a.time_ns);
    let share = if span > 0 { time_ns.saturating_sub(a.time_ns) as f64 / span as f64 } else { 1.0 };
    Reading { time_ns, gyro: a.gyro.lerp(&b.gyro, share), accel: a.accel.lerp(&b.accel, share) }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

#[cfg(test)]
mod tests;
