//! How good a mean of the specific force is as the direction of gravity, by the method of batch means.

use evac_geometry::nalgebra::{UnitQuaternion, Vector3};

/// Length of a batch, about two steps of a walker.
const BATCH_S: f64 = 1.0;
const BATCHES: usize = 3;

/// Means of the specific force over the last seconds, turned into the present IMU frame.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Batches {
    /// The one that grows first; it counts from half its length on.
    means: [Vector3<f64>; BATCHES + 1],
    seconds: f64,
    full: usize,
}

impl Batches {
    /// Takes a reading of `h` seconds; `turn` brings what was measured before it into its frame.
    pub(crate) fn take(&mut self, turn: &UnitQuaternion<f64>, force: &Vector3<f64>, h: f64) {
        self.means.iter_mut().for_each(|mean| *mean = turn * *mean);
        if self.seconds >= BATCH_S {
            self.means.rotate_right(1);
            (self.means[0], self.seconds) = (Vector3::zeros(), 0.0);
            self.full = (self.full + 1).min(BATCHES);
        }
        self.seconds += h;
        self.means[0] += (force - self.means[0]) * (h / self.seconds);
    }

    /// Standard error of the mean across gravity by the method of batch means, m/s^2 an axis: a walker who sets off or stops meanwhile has
    /// a mean acceleration that one in full stride has not.
    pub(crate) fn error(&self) -> f64 {
        let first = usize::from(self.seconds < BATCH_S / 2.0);
        let full = self.means.get(first..=self.full).unwrap_or_default();
        let n = full.len() as f64;
        let mean = full.iter().sum::<Vector3<f64>>() / n.max(1.0);
        let Some(up) = mean.try_normalize(1.0) else { return 0.0 };
        let across = |batch: &Vector3<f64>| (batch - up * up.dot(batch)).norm_squared() / 2.0;
        if full.len() < 2 { 0.0 } else { (full.iter().map(across).sum::<f64>() / (n * (n - 1.0))).sqrt() }
    }
}
