//! How the rig is carried, for a time without an IMU.
//!
//! A walker's velocity swings about its mean with every step, up and down by as much as 0.4 m/s. What it was when the IMU fell silent is forgotten
//! within a tenth of a second; what stays is the mean, and how far it swings is known from the time before. The same holds for
//! the rate of rotation, whose mean is nothing.

use evac_geometry::nalgebra::{Matrix3, Vector3};

/// Time over which means are taken, seconds: more than a step.
const MEMORY_S: f64 = 0.7;
/// Change of the mean velocity that is reckoned with all the same, m/s (standard deviation per axis).
const CHANGE: f64 = 0.15;

/// After a gap the velocity is compared with the mean before it once so much time has passed, seconds: some steps.
const STEPS_S: f64 = 1.0;
/// Change of the mean climb that is reckoned with meanwhile, m/s (standard deviation).
pub(crate) const CLIMB_CHANGE: f64 = 0.1;

/// Motion of the frames before.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Habit {
    /// Mean angular velocity of the last frame, IMU frame.
    pub(crate) rate: Vector3<f64>,
    /// Mean velocity, map frame.
    pub(crate) velocity: Vector3<f64>,
    swing: Matrix3<f64>,
    /// Mean square of the angular velocity, IMU frame.
    pub(crate) turning: Matrix3<f64>,
    since_gap: Option<SinceGap>,
}

/// The way since the end of the last gap.
#[derive(Debug, Clone, Copy)]
struct SinceGap {
    /// Mean velocity before the gap.
    velocity_before: Vector3<f64>,
    seconds: f64,
    way: Vector3<f64>,
}

impl Habit {
    /// Takes a frame of `seconds` that ends with `velocity` and in which the rig turned at `rate`.
    pub(crate) fn take(&mut self, seconds: f64, velocity: &Vector3<f64>, rate: &Vector3<f64>) {
        self.rate = *rate;
        let share = 1.0 - (-seconds / MEMORY_S).exp();
        let off = velocity - self.velocity;
        self.velocity += off * share;
        self.swing += (off * off.transpose() * (1.0 - share) - self.swing) * share;
        self.turning += (rate * rate.transpose() - self.turning) * share;
    }

    /// A frame without an IMU, in which the rig turned at `rate`.
    pub(crate) fn miss(&mut self, rate: &Vector3<f64>) {
        self.rate = *rate;
        self.since_gap =
            Some(SinceGap { velocity_before: self.velocity, seconds: 0.0, way: Vector3::zeros() });
    }

    /// Some steps after a gap, once: by how much the velocity has been above the mean before it, in all directions. That is as good as constant, since the
    /// IMU knows how a gait swings; of the vertical the mean is known well.
    pub(crate) fn off_since_gap(&mut self, seconds: f64, velocity: &Vector3<f64>) -> Option<Vector3<f64>> {
        let since = self.since_gap.as_mut()?;
        since.seconds += seconds;
        since.way += velocity * seconds;
        let since = self.since_gap.take_if(|since| since.seconds > STEPS_S)?;
        Some(since.way / since.seconds - since.velocity_before)
    }

    /// Covariance of the velocity at any time about the mean.
    pub(crate) fn scatter(&self) -> Matrix3<f64> {
        self.swing + Matrix3::identity() * CHANGE.powi(2)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn of_a_gait_the_mean_stays_and_how_far_it_swings() {
        let mut habit = Habit::default();
        for frame in 0..50 {
            let swing = (TAU * 1.9 * f64::from(frame) * 0.1).sin();
            let rate = Vector3::new(0.0, 0.3 * swing, 0.0);
            habit.take(0.1, &Vector3::new(1.2, 0.0, 0.4 * swing), &rate);
        }
        assert!((habit.velocity - Vector3::new(1.2, 0.0, 0.0)).norm() < 0.1, "{}", habit.velocity);
        let [along, across, up] = [0, 1, 2].map(|axis| habit.scatter()[(axis, axis)].sqrt());
        assert!(along < 0.2 && (across - CHANGE).abs() < 1e-9, "{along} {across}");
        assert!((up - (0.08 + CHANGE.powi(2)).sqrt()).abs() < 0.05, "{up}");
        let rolls = habit.turning.diagonal().map(f64::sqrt);
        assert!((rolls.y - 0.21).abs() < 0.05 && rolls.xz().norm() < 1e-9, "{rolls}");
    }

    #[test]
    fn a_velocity_that_comes_out_of_a_gap_wrong_shows_by_its_mean_over_the_next_steps() {
        let mut habit = Habit::default();
        let gait = |frame: i32| Vector3::new(1.2, 0.0, 0.4 * (TAU * 1.9 * f64::from(frame) * 0.1).sin());
        (0..50).for_each(|frame| habit.take(0.1, &gait(frame), &Vector3::zeros()));
        (50..55).for_each(|_| habit.miss(&Vector3::zeros()));
        let wrong = Vector3::new(0.0, 0.0, 0.5);
        let off: Vec<_> =
            (55..90).filter_map(|frame| habit.off_since_gap(0.1, &(gait(frame) + wrong))).collect();
        assert_eq!(off.len(), 1);
        assert!((off[0] - wrong).norm() < 0.1, "{}", off[0]);
    }
}
