//! Pose and velocity of the IMU with their covariance: the motion prior that the scan match corrects.

use evac_geometry::exp_so3;
use evac_geometry::nalgebra::{Isometry3, Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

/// Position, rotation about the map's axes and velocity.
pub(crate) const STATES: usize = 9;
pub(crate) const POSITION: usize = 0;
pub(crate) const ROTATION: usize = 3;
pub(crate) const VELOCITY: usize = 6;

/// Covariance or its parts, metres, radians and m/s.
pub(crate) type Covariance = SMatrix<f64, STATES, STATES>;
/// An error of position and rotation in the map frame, the latter multiplied from the left.
pub(crate) type PoseError = SVector<f64, 6>;
/// Information about it.
pub(crate) type PoseInformation = SMatrix<f64, 6, 6>;

/// Bias of a gyroscope or accelerometer of this class cannot be larger, rad/s and m/s^2.
const MAX_GYRO_BIAS: f64 = 0.02;
const MAX_ACCEL_BIAS: f64 = 0.3;
/// Share of a frame's correction that is taken for a bias: both are found within some seconds.
const GYRO_GAIN: f64 = 0.02;
const ACCEL_GAIN: f64 = 0.02;

/// The estimate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Filter {
    /// End of the frame that the pose holds at, sensor time.
    pub(crate) stamp_ns: i64,
    pub(crate) position: Vector3<f64>,
    /// `map_from_imu`.
    pub(crate) rotation: UnitQuaternion<f64>,
    /// Map frame, m/s.
    pub(crate) velocity: Vector3<f64>,
    /// Angular velocity over the last frame, rad/s, IMU frame.
    pub(crate) rate: Vector3<f64>,
    /// IMU frame.
    pub(crate) gyro_bias: Vector3<f64>,
    pub(crate) accel_bias: Vector3<f64>,
    pub(crate) covariance: Covariance,
}

impl Filter {
    /// At rest at `map_from_imu`, with that standard deviation of the velocity.
    pub(crate) fn new(stamp_ns: i64, map_from_imu: &Isometry3<f64>, speed: f64, tilt: f64) -> Self {
        let mut filter = Self {
            stamp_ns,
            position: map_from_imu.translation.vector,
            rotation: map_from_imu.rotation,
            velocity: Vector3::zeros(),
            rate: Vector3::zeros(),
            gyro_bias: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
            covariance: Covariance::zeros(),
        };
        filter.add_variance(POSITION, 1e-8);
        filter.add_variance(ROTATION, tilt.powi(2));
        filter.add_variance(VELOCITY, speed.powi(2));
        filter
    }

    pub(crate) fn map_from_imu(&self) -> Isometry3<f64> {
        Isometry3::from_parts(self.position.into(), self.rotation)
    }

    /// Adds a variance to one of the three parts of the state.
    pub(crate) fn add_variance(&mut self, part: usize, variance: f64) {
        for i in part..part + 3 {
            self.covariance[(i, i)] += variance;
        }
    }

    /// Carries the covariance over `h` seconds; `force` is the specific force in the map frame, m/s^2, by which a tilt becomes
    /// acceleration (zero without IMU).
    pub(crate) fn propagate_covariance(&mut self, h: f64, force: &Vector3<f64>) {
        let mut f = Covariance::identity();
        let by_tilt = -evac_geometry::skew(force);
        f.fixed_view_mut::<3, 3>(POSITION, VELOCITY).copy_from(&(Matrix3::identity() * h));
        f.fixed_view_mut::<3, 3>(POSITION, ROTATION).copy_from(&(by_tilt * (h * h / 2.0)));
        f.fixed_view_mut::<3, 3>(VELOCITY, ROTATION).copy_from(&(by_tilt * h));
        self.covariance = f * self.covariance * f.transpose();
    }

    /// The correction of all states that belongs to information about the pose: minimises `d' P^-1 d + (d_pose - s)' A (d_pose - s)`
    /// with `vector = A s`, without inverting either. `offset` is the pose error at which it was taken.
    pub(crate) fn correction(
        &self,
        information: &PoseInformation,
        vector: &PoseError,
        offset: &PoseError,
    ) -> Option<SVector<f64, STATES>> {
        let p_pose: PoseInformation = self.covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let system = PoseInformation::identity() + information * p_pose;
        let y = system.lu().solve(&(vector + information * offset))?;
        Some(self.covariance.fixed_columns::<6>(0) * y)
    }

    /// Takes a correction in, and the information that it came from.
    pub(crate) fn correct(&mut self, d: &SVector<f64, STATES>, information: &PoseInformation) {
        let p_pose: PoseInformation = self.covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let system = PoseInformation::identity() + information * p_pose;
        if let Some(gain) = system.lu().solve(information) {
            let columns = self.covariance.fixed_columns::<6>(0).into_owned();
            self.covariance -= columns * gain * columns.transpose();
            self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        }
        (self.position, self.rotation) = self.moved(&d.fixed_rows::<6>(0).into_owned());
        self.velocity += d.fixed_rows::<3>(VELOCITY).into_owned();
    }

    /// Learns the IMU's biases from how the match corrected a frame of `h` seconds.
    pub(crate) fn learn_biases(&mut self, d: &SVector<f64, STATES>, h: f64) {
        let in_imu = |part: usize| self.rotation.inverse() * d.fixed_rows::<3>(part).into_owned() / h;
        let (turn, push) = (in_imu(ROTATION), in_imu(VELOCITY));
        self.gyro_bias = (self.gyro_bias - turn * GYRO_GAIN).cap_magnitude(MAX_GYRO_BIAS);
        self.accel_bias = (self.accel_bias - push * ACCEL_GAIN).cap_magnitude(MAX_ACCEL_BIAS);
    }

    /// Position and rotation with an error taken off.
    pub(crate) fn moved(&self, d: &PoseError) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let mut rotation = exp_so3(&d.fixed_rows::<3>(ROTATION).into_owned()) * self.rotation;
        rotation.renormalize();
        (self.position + d.fixed_rows::<3>(POSITION).into_owned(), rotation)
    }

    /// Whether everything is a number.
    pub(crate) fn is_finite(&self) -> bool {
        let parts = [self.position, self.velocity, self.rate, self.gyro_bias, self.accel_bias];
        parts.iter().flat_map(|part| part.iter()).all(|value| value.is_finite())
            && self.rotation.coords.iter().all(|value| value.is_finite())
            && self.covariance.iter().all(|value| value.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filter() -> Filter {
        Filter::new(0, &Isometry3::identity(), 0.5, 0.01)
    }

    #[test]
    fn a_position_that_is_seen_corrects_the_velocity_and_one_that_is_not_stays_uncertain() {
        let mut filter = filter();
        filter.propagate_covariance(0.1, &Vector3::zeros());
        let mut information = PoseInformation::zeros();
        information[(0, 0)] = 1e6;
        let mut vector = PoseError::zeros();
        vector[0] = 1e6 * 0.02;
        let d = filter.correction(&information, &vector, &PoseError::zeros()).unwrap();
        filter.correct(&d, &information);
        assert!((filter.position.x - 0.02).abs() < 1e-4);
        assert!((filter.velocity.x - 0.2).abs() < 2e-3 && filter.velocity.y == 0.0);
        let sigma = |i: usize| filter.covariance[(i, i)].sqrt();
        assert!(sigma(0) < 1.1e-3 && (sigma(1) - 0.05).abs() < 1e-3);
    }

    #[test]
    fn a_tilt_that_is_not_known_becomes_a_velocity_that_is_not_known() {
        let mut filter = filter();
        let before = filter.covariance[(VELOCITY, VELOCITY)];
        for _ in 0..10 {
            filter.propagate_covariance(0.1, &Vector3::new(0.0, 0.0, 9.8));
        }
        let grown = (filter.covariance[(VELOCITY, VELOCITY)] - before).sqrt();
        assert!((grown - 0.098).abs() < 1e-3, "{grown}");
        let z = filter.covariance[(VELOCITY + 2, VELOCITY + 2)];
        assert!((z - before).abs() < 1e-9);
    }

    #[test]
    fn a_turn_that_the_match_takes_back_again_and_again_is_a_gyroscope_bias() {
        let mut filter = filter();
        let mut d = SVector::<f64, STATES>::zeros();
        // 0.01 rad/s too much about z over every frame, less what was learnt.
        for _ in 0..300 {
            d[ROTATION + 2] = -(0.01 - filter.gyro_bias.z) * 0.1;
            filter.learn_biases(&d, 0.1);
        }
        assert!((filter.gyro_bias - Vector3::new(0.0, 0.0, 0.01)).norm() < 1e-4);
    }
}
