//! The coarse search for the offset between the clocks of IMU and LiDAR, over a range in which the filter's own time
//! offset, a linear state, cannot follow.
//!
//! While the rig starts to move, each scan is also matched by itself, without the IMU. The rotations from scan to scan
//! that this gives are compared with those of the gyroscope, read with every offset on a grid; the offset at which
//! both agree is the one.

use evac_geometry::log_so3;
use evac_geometry::nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Offsets tried: -120 to 120 ms in steps of 4 ms.
const STEP_NS: i64 = 4_000_000;
const HALF_STEPS: i64 = 30;
const CANDIDATES: usize = 2 * HALF_STEPS as usize + 1;
/// Gyroscope readings kept: 5 s at 200 Hz.
const MAX_READINGS: usize = 1024;
/// Rotations waiting for the gyroscope's readings of the time after them.
const MAX_WAITING: usize = 16;
/// Rotations before a change, before the search ends, and after which it ends without a result.
const MIN_ROTATIONS: u32 = 6;
const ENOUGH_ROTATIONS: u32 = 12;
const MAX_ROTATIONS: u32 = 100;
/// Standard deviation of the offset at which it is believed, seconds.
const BELIEVED_S: f64 = 0.002;
/// ... and at which agreement with what is believed is no accident.
const PLAUSIBLE_S: f64 = 0.01;
/// Smallest change that is worth disturbing the filter for, seconds.
const MIN_CHANGE_S: f64 = 0.006;
/// ... and what it must be in standard deviations.
const CHANGE_SIGMAS: f64 = 3.0;
/// How much smaller one change is than the one before it, for it to be one of a series.
const MIN_SHRINKAGE: f64 = 1.2;
const MAX_SHRINKAGE: f64 = 20.0;
/// Error of a rotation from scan to scan that the match does not know of, rad.
const MIN_ROTATION_ERROR: f64 = 1e-3;
/// Smaller rotations from scan to scan say nothing, rad.
const MIN_TURN: f64 = 4e-3;
/// Differences may be smaller than their variances say, those stay cautious: squared, down to this.
const MIN_EXCESS: f64 = 0.25;
/// Corrections before the search gives up.
const MAX_ROUNDS: u32 = 8;

/// What a rotation led to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Found {
    /// Nothing yet.
    Searching,
    /// The offset is what was assumed, or cannot be found: the search is over.
    Settled,
    /// The offset is this, seconds to add to an IMU stamp.
    Changed(f64),
}

/// The search; it allocates once.
#[derive(Debug)]
pub(crate) struct OffsetSearch {
    /// Stamps of the IMU and the integral of the angular velocity up to them, rad.
    turned: Vec<(i64, Vector3<f64>)>,
    rate: Vector3<f64>,
    waiting: Vec<Rotation>,
    /// Rotation of the IMU at the last scan.
    last: Option<Attitude>,
    /// Sum of squared differences of each offset, in units of their variance.
    costs: [f64; CANDIDATES],
    rotations: u32,
    rounds: u32,
    over: bool,
    plausible: bool,
    /// The offset that was assumed in the last round, and how much that was changed, seconds.
    last_change: Option<(f64, f64)>,
}

/// How the LiDAR alone sees the IMU stand in the middle of a scan: its points were brought to the scan's end by an IMU that may have
/// the wrong time, which spoils the end, but to first order not the middle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Attitude {
    /// Middle of the scan by the LiDAR's clock.
    pub(crate) stamp_ns: i64,
    pub(crate) map_from_imu: UnitQuaternion<f64>,
    /// Covariance of its error, IMU frame, rad^2: a scan may show two axes well and the third not at all.
    pub(crate) covariance: Matrix3<f64>,
}

/// What the LiDAR turned by between two times of its own clock, IMU frame.
#[derive(Debug, Clone, Copy)]
struct Rotation {
    start_ns: i64,
    end_ns: i64,
    turn: Vector3<f64>,
    /// Inverse of the turn's covariance.
    weight: Matrix3<f64>,
}

impl Rotation {
    fn between(before: &Attitude, after: &Attitude) -> Option<Self> {
        let turned = before.map_from_imu.inverse() * after.map_from_imu;
        let back = turned.inverse().to_rotation_matrix();
        let covariance = after.covariance
            + back.matrix() * before.covariance * back.matrix().transpose()
            + Matrix3::identity() * MIN_ROTATION_ERROR.powi(2);
        let weight = covariance.try_inverse()?;
        Some(Self { start_ns: before.stamp_ns, end_ns: after.stamp_ns, turn: log_so3(&turned), weight })
    }
}

impl OffsetSearch {
    pub(crate) fn new() -> Self {
        Self {
            turned: Vec::with_capacity(MAX_READINGS),
            rate: Vector3::zeros(),
            waiting: Vec::with_capacity(MAX_WAITING),
            last: None,
            costs: [0.0; CANDIDATES],
            rotations: 0,
            rounds: 0,
            over: false,
            plausible: false,
            last_change: None,
        }
    }

    /// Whether there is nothing more to search for.
    pub(crate) fn is_over(&self) -> bool {
        self.over
    }

    /// Takes a gyroscope reading, rad/s.
    pub(crate) fn push_rate(&mut self, stamp_ns: i64, rate: Vector3<f64>) {
        if self.over {
            return;
        }
        let turned = match self.turned.last() {
            Some((last_ns, _)) if stamp_ns <= *last_ns => return,
            Some((last_ns, turned)) => turned + (self.rate + rate) * ((stamp_ns - last_ns) as f64 * 0.5e-9),
            None => Vector3::zeros(),
        };
        if self.turned.len() == MAX_READINGS {
            self.turned.drain(..MAX_READINGS / 4);
        }
        self.turned.push((stamp_ns, turned));
        self.rate = rate;
    }

    /// Whether the offset that is believed now may well be right, or there is nothing more to search for.
    pub(crate) fn is_plausible(&self) -> bool {
        self.over || self.plausible
    }

    /// Forgets the last scan: the next one does not follow it.
    pub(crate) fn interrupt(&mut self) {
        self.last = None;
    }

    /// Forgets everything, for new clocks.
    pub(crate) fn restart(&mut self) {
        self.turned.clear();
        self.over = false;
        self.rounds = 0;
        self.last_change = None;
        self.begin_round();
    }

    /// Takes what the LiDAR alone said about a scan; `assumed_s` is the offset that is believed now, and whether the scan
    /// `fits` the map with it.
    pub(crate) fn push_attitude(&mut self, attitude: Attitude, assumed_s: f64, fits: bool) -> Found {
        if let Some(before) = self.last.replace(attitude)
            && self.waiting.len() < MAX_WAITING
        {
            self.waiting.extend(Rotation::between(&before, &attitude));
        }
        let newest_ns = self.turned.last().map_or(i64::MIN, |(stamp_ns, _)| *stamp_ns);
        while let Some(rotation) = self.waiting.first().copied()
            && rotation.end_ns + STEP_NS * HALF_STEPS < newest_ns
        {
            self.waiting.remove(0);
            self.compare(&rotation);
        }
        self.decide(assumed_s, fits)
    }

    fn compare(&mut self, rotation: &Rotation) {
        if rotation.turn.norm() < MIN_TURN {
            return;
        }
        let mut costs = [0.0; CANDIDATES];
        for (index, cost) in costs.iter_mut().enumerate() {
            let offset_ns = offset_ns(index);
            let (Some(from), Some(to)) =
                (self.turned_at(rotation.start_ns - offset_ns), self.turned_at(rotation.end_ns - offset_ns))
            else {
                return;
            };
            let difference = rotation.turn - (to - from);
            *cost = difference.dot(&(rotation.weight * difference));
        }
        self.rotations += 1;
        self.costs.iter_mut().zip(costs).for_each(|(sum, cost)| *sum += cost);
    }

    fn decide(&mut self, assumed_s: f64, fits: bool) -> Found {
        if self.rotations < MIN_ROTATIONS {
            return Found::Searching;
        }
        let best = (0..CANDIDATES).min_by(|a, b| self.costs[*a].total_cmp(&self.costs[*b])).unwrap_or(0);
        if let Some((offset_s, sigma_s)) = self.minimum(best) {
            let change_s = offset_s - assumed_s;
            let is_wrong = change_s.abs() > MIN_CHANGE_S.max(CHANGE_SIGMAS * sigma_s);
            if is_wrong && self.rounds < MAX_ROUNDS {
                // Scans were deskewed with the wrong offset, which blurs the rotations: once more with the new one.
                let next_s = self.extrapolated(assumed_s, change_s);
                self.rounds += 1;
                self.begin_round();
                self.last_change = Some((assumed_s, change_s));
                return Found::Changed(next_s);
            }
            self.plausible = sigma_s < PLAUSIBLE_S;
            self.over = fits && self.rotations >= ENOUGH_ROTATIONS && sigma_s < BELIEVED_S;
        }
        self.over |= self.rotations >= MAX_ROTATIONS;
        if self.over { Found::Settled } else { Found::Searching }
    }

    /// Rotations of scans that were deskewed with a wrong offset say too little of the change: where two changes in a row go
    /// the same way, on to where none would be left.
    fn extrapolated(&self, assumed_s: f64, change_s: f64) -> f64 {
        let plain_s = assumed_s + change_s;
        let Some((before_s, changed_s)) = self.last_change else { return plain_s };
        let shrinkage = changed_s / change_s;
        if !(MIN_SHRINKAGE..MAX_SHRINKAGE).contains(&shrinkage) {
            return plain_s;
        }
        let limit_s = (STEP_NS * HALF_STEPS) as f64 * 1e-9;
        (before_s + changed_s * (assumed_s - before_s) / (changed_s - change_s)).clamp(-limit_s, limit_s)
    }

    fn begin_round(&mut self) {
        self.waiting.clear();
        self.last = None;
        self.costs = [0.0; CANDIDATES];
        self.rotations = 0;
        self.plausible = false;
    }

    /// Minimum of the parabola through the best offset and its neighbours, seconds, with its standard deviation; `None` at
    /// the border of the range.
    fn minimum(&self, best: usize) -> Option<(f64, f64)> {
        let (before, here, after) =
            (*self.costs.get(best.checked_sub(1)?)?, *self.costs.get(best)?, *self.costs.get(best + 1)?);
        let step_s = STEP_NS as f64 * 1e-9;
        let curvature = (before - 2.0 * here + after) / (step_s * step_s);
        if curvature <= 0.0 {
            return None;
        }
        let shift_s = (before - after) / (2.0 * curvature * step_s);
        // Differences of another size than their variances say that those are wrong.
        let excess = (here / (3.0 * f64::from(self.rotations))).max(MIN_EXCESS);
        Some((offset_ns(best) as f64 * 1e-9 + shift_s, (2.0 * excess / curvature).sqrt()))
    }

    /// Integral of the angular velocity at a stamp of the IMU.
    fn turned_at(&self, stamp_ns: i64) -> Option<Vector3<f64>> {
        let after = self.turned.partition_point(|(stamp, _)| *stamp <= stamp_ns);
        let (from_ns, from) = self.turned.get(after.checked_sub(1)?)?;
        let (to_ns, to) = self.turned.get(after)?;
        let share = (stamp_ns - from_ns) as f64 / (to_ns - from_ns).max(1) as f64;
        Some(from.lerp(to, share))
    }
}

fn offset_ns(index: usize) -> i64 {
    (index as i64 - HALF_STEPS) * STEP_NS
}

#[cfg(test)]
mod tests;
