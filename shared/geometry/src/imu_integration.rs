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

/// The IMU's motion at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuKnot {
    /// Nanoseconds of the scans' time base (the time offset is applied).
    pub time_ns: i64,
    /// Orientation of the IMU in the world.
    pub world_from_imu: UnitQuaternion<f64>,
    /// Position of the IMU in the world, metres.
    pub position: Vector3<f64>,
    /// Velocity of the IMU in the world, m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity without bias, rad/s, IMU frame.
    pub angular_velocity: Vector3<f64>,
    /// Acceleration without bias and gravity, m/s^2, world frame.
    pub acceleration: Vector3<f64>,
}

impl ImuKnot {
    /// Pose of the IMU in the world.
    pub fn world_from_imu(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.position), self.world_from_imu)
    }
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
    knots: Vec<ImuKnot>,
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
    /// a sample is missing (see [`ImuCoverage`]). With an `end_ns` not after the start the only knot is the start.
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

    /// The motion at the start, at each used sample and at the end, in order of time. Empty before the first integration.
    pub fn knots(&self) -> &[ImuKnot] {
        &self.knots
    }

    /// The motion at the end; `None` before the first integration.
    pub fn end(&self) -> Option<&ImuKnot> {
        self.knots.last()
    }

    /// The state at the end, from which the next integral goes on; `start` is the one this integral began with.
    pub fn end_state(&self, start: &ImuState) -> ImuState {
        self.end().map_or(*start, |knot| ImuState {
            time_ns: knot.time_ns,
            world_from_imu: knot.world_from_imu,
            position: knot.position,
            velocity: knot.velocity,
            ..*start
        })
    }

    /// Running estimate of the time between samples, nanoseconds.
    pub fn period_ns(&self) -> f64 {
        self.period_ns
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
        self.knots.push(ImuKnot {
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
        self.knots.push(ImuKnot {
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
        if self.knots.is_empty() {
            let coasting = Reading {
                time_ns: start.time_ns,
                gyro: start.gyro_bias,
                accel: start.accel_bias - start.world_from_imu.inverse() * start.gravity,
            };
            coverage.used += usize::from(last.is_some());
            self.begin(start, &last.unwrap_or(coasting));
        }
        let covered_to = last.map_or(start.time_ns, |reading| reading.time_ns);
        coverage.uncovered_end_ns = end_ns.saturating_sub(covered_to).max(0);
        if let Some(knot) = self.knots.last() {
            let gyro = knot.angular_velocity + start.gyro_bias;
            let accel = last.map_or(
                start.accel_bias + knot.world_from_imu.inverse() * (knot.acceleration - start.gravity),
                |reading| reading.accel,
            );
            self.step(start, &Reading { time_ns: end_ns, gyro, accel });
        }
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
mod tests {
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
        assert_eq!(integrator.knots().len(), 21);
        for pair in integrator.knots().windows(2) {
            let almost = integrator.pose_at(pair[1].time_ns - 1);
            let error = pair[1].world_from_imu().inverse() * almost;
            assert!(error.translation.vector.norm() < 1e-8 && log_so3(&error.rotation).norm() < 1e-8);
        }
        assert_eq!(integrator.end().unwrap().time_ns, 98_000_000);
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
        let start = ImuState {
            gyro_bias,
            accel_bias,
            time_offset_ns: 7_000_000,
            ..start(Vector3::new(1.5, 0.0, 0.0))
        };
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
        assert!((integrator.period_ns() / 20e6 - 1.0).abs() < 0.05);
    }

    #[test]
    fn where_samples_are_missing_at_the_borders_their_neighbours_are_held_and_it_is_told() {
        let mut integrator = ImuIntegrator::new(64);
        let turn =
            |stamp_ns| ImuSample { stamp_ns, gyro: [0.0, 0.0, 1.0], accel: UP.into(), ..Default::default() };
        let coverage = integrator.integrate(
            &start(Vector3::zeros()),
            &[turn(20_000_000), turn(30_000_000)],
            100_000_000,
        );
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
        let coverage =
            integrator.integrate(&start(Vector3::zeros()), &samples(0, 100_000_000, 5_000_000), 100_000_000);
        assert!(coverage.skipped > 0 && integrator.knots().len() <= 10);
        assert_eq!(integrator.end().unwrap().time_ns, 100_000_000);
    }
}
