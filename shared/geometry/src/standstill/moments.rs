//! Means and variances of IMU samples.

use evac_frames::ImuSample;
use nalgebra::Vector3;

use super::Standstill;

/// Sums over samples. Gravity is about 10 m/s^2 and the noise 0.01: in `f64` the difference of squares is good to 1e-10.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    pub(super) samples: u64,
    pub(super) start_ns: i64,
    pub(super) end_ns: i64,
    accel: Vector3<f64>,
    accel_squared: Vector3<f64>,
    gyro: Vector3<f64>,
    gyro_squared: Vector3<f64>,
}

impl Moments {
    pub(super) fn add(&mut self, sample: &ImuSample) {
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
    pub(super) fn merge(&mut self, later: &Self) {
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

    pub(super) fn mean_accel(&self) -> Vector3<f64> {
        self.accel / self.samples.max(1) as f64
    }

    pub(super) fn mean_gyro(&self) -> Vector3<f64> {
        self.gyro / self.samples.max(1) as f64
    }

    pub(super) fn accel_variance(&self) -> Vector3<f64> {
        variance(self.samples, &self.accel, &self.accel_squared)
    }

    pub(super) fn gyro_variance(&self) -> Vector3<f64> {
        variance(self.samples, &self.gyro, &self.gyro_squared)
    }

    pub(super) fn standstill(&self, held_at_zero: bool) -> Standstill {
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
