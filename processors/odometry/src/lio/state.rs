//! The filter's state and its error: `x = x_hat [+] d` with `R = R_hat Exp(d_theta)`, all else additive.

use evac_geometry::{STANDARD_GRAVITY, exp_so3};
use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

/// Dimension of the error of what propagation knows of: motion, gravity and sensors.
pub(crate) const OWN: usize = 25;
/// Older sections of the map whose places are part of the state; see [`super::sections`].
pub(crate) const CLONES: usize = 4;
/// Dimension of the places.
pub(crate) const PLACES: usize = 6 * CLONES;
/// Dimension of the error state: after its own part come the places of older sections, 6 each.
pub(crate) const DIM: usize = OWN + PLACES;
/// The measured part of its own comes first: rotation, position, time offset.
pub(crate) const MEASURED: usize = 7;
/// The part that moves while time passes, the measured one and the velocity, comes first too.
pub(crate) const MOVING: usize = 10;

/// First index of each part of the error state.
pub(crate) mod at {
    pub(crate) const ROTATION: usize = 0;
    pub(crate) const POSITION: usize = 3;
    pub(crate) const TIME_OFFSET: usize = 6;
    pub(crate) const VELOCITY: usize = 7;
    pub(crate) const GYRO_BIAS: usize = 10;
    pub(crate) const ACCEL_BIAS: usize = 13;
    pub(crate) const GRAVITY: usize = 16;
    pub(crate) const GYRO_SCALE: usize = 19;
    pub(crate) const MISALIGNMENT: usize = 22;
    pub(crate) const CLONES: usize = super::OWN;

    /// Place of the older section in `slot`: rotation about the map's axes, displacement of the map's origin.
    pub(crate) const fn clone(slot: usize) -> usize {
        CLONES + 6 * slot
    }
}

/// Error of the state.
pub(crate) type Error = SVector<f64, DIM>;
/// Covariance of the error.
pub(crate) type Covariance = SMatrix<f64, DIM, DIM>;

/// Nominal state of the IMU in the map frame, SI units.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    /// `map_from_imu` rotation.
    pub(crate) rotation: UnitQuaternion<f64>,
    /// Position of the IMU in the map.
    pub(crate) position: Vector3<f64>,
    /// Velocity of the IMU in the map.
    pub(crate) velocity: Vector3<f64>,
    /// Gyroscope bias, IMU frame.
    pub(crate) gyro_bias: Vector3<f64>,
    /// Accelerometer bias, IMU frame.
    pub(crate) accel_bias: Vector3<f64>,
    /// Gravity in the map frame; its norm is standard gravity.
    pub(crate) gravity: Vector3<f64>,
    /// Error of the gyroscope's scale per axis: a true rate `w` reads `(1 + scale) w + bias`.
    pub(crate) gyro_scale: Vector3<f64>,
    /// Rotation from the axes that the IMU really has to those that the rig's extrinsic gives it, rad: what the
    /// configured `imu_from_lidar` is off by. The state's own IMU frame is the configured one, fixed to the LiDAR.
    pub(crate) misalignment: Vector3<f64>,
    /// Seconds to add to an IMU stamp to get LiDAR time.
    pub(crate) time_offset_s: f64,
    /// Where older sections of the map lie: `current_from_section`. The map frame of all else is the current section's.
    pub(crate) places: [Isometry3<f64>; CLONES],
}

impl State {
    /// `x [+] d`; gravity is brought back to its norm.
    pub(crate) fn plus(&self, d: &Error) -> Self {
        let part = |i: usize| d.fixed_rows::<3>(i).into_owned();
        let mut rotation = self.rotation * exp_so3(&part(at::ROTATION));
        rotation.renormalize();
        let gravity = self.gravity + part(at::GRAVITY);
        let mut places = self.places;
        for (slot, place) in places.iter_mut().enumerate() {
            let (turn, way) = (part(at::clone(slot)), part(at::clone(slot) + 3));
            *place = Isometry3::from_parts(Translation3::from(way), exp_so3(&turn)) * *place;
            place.rotation.renormalize();
        }
        Self {
            rotation,
            position: self.position + part(at::POSITION),
            velocity: self.velocity + part(at::VELOCITY),
            gyro_bias: self.gyro_bias + part(at::GYRO_BIAS),
            accel_bias: self.accel_bias + part(at::ACCEL_BIAS),
            gravity: gravity * (STANDARD_GRAVITY / gravity.norm()),
            gyro_scale: self.gyro_scale + part(at::GYRO_SCALE),
            misalignment: self.misalignment + part(at::MISALIGNMENT),
            time_offset_s: self.time_offset_s + d[at::TIME_OFFSET],
            places,
        }
    }

    /// A state at rest in the map's origin, level, with nothing known about the sensors.
    pub(crate) fn at_origin() -> Self {
        Self {
            rotation: UnitQuaternion::identity(),
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            gyro_bias: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
            gravity: Vector3::new(0.0, 0.0, -STANDARD_GRAVITY),
            gyro_scale: Vector3::zeros(),
            misalignment: Vector3::zeros(),
            time_offset_s: 0.0,
            places: [Isometry3::identity(); CLONES],
        }
    }

    /// The same state in another map frame; the places stay.
    pub(crate) fn moved(&self, new_from_old: &Isometry3<f64>) -> Self {
        let pose = new_from_old * self.map_from_imu();
        Self {
            rotation: pose.rotation,
            position: pose.translation.vector,
            velocity: new_from_old.rotation * self.velocity,
            gravity: new_from_old.rotation * self.gravity,
            ..*self
        }
    }

    /// True angular velocity behind a gyroscope reading, to first order in the scale error.
    pub(crate) fn rate_of(&self, gyro: &Vector3<f64>) -> Vector3<f64> {
        let unbiased = gyro - self.gyro_bias;
        exp_so3(&self.misalignment) * (unbiased - self.gyro_scale.component_mul(&unbiased))
    }

    /// True specific force behind an accelerometer reading.
    pub(crate) fn force_of(&self, accel: &Vector3<f64>) -> Vector3<f64> {
        exp_so3(&self.misalignment) * (accel - self.accel_bias)
    }

    /// The time offset in nanoseconds.
    pub(crate) fn offset_ns(&self) -> i64 {
        (self.time_offset_s * 1e9) as i64
    }

    /// Pose of the IMU.
    pub(crate) fn map_from_imu(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.position), self.rotation)
    }

    /// Whether every number is finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.rotation.coords.iter().all(|x| x.is_finite())
            && [self.position, self.velocity, self.gyro_bias, self.accel_bias, self.gravity]
                .iter()
                .chain([&self.gyro_scale, &self.misalignment])
                .all(|v| v.iter().all(|x| x.is_finite()))
            && self.time_offset_s.is_finite()
            && self.places.iter().all(|place| place.to_homogeneous().iter().all(|x| x.is_finite()))
    }
}

/// Largest standard deviation of the three errors from `index` on, in any direction.
pub(crate) fn largest_sigma<const N: usize>(covariance: &SMatrix<f64, N, N>, index: usize) -> f64 {
    let block = covariance.fixed_view::<3, 3>(index, index).into_owned();
    block.symmetric_eigenvalues().max().max(0.0).sqrt()
}

/// Adds `variance` to three diagonal entries from `index` on.
pub(crate) fn add_variance(covariance: &mut Covariance, index: usize, variance: f64) {
    for i in index..index + 3 {
        covariance[(i, i)] += variance;
    }
}

/// Adds `variance` across gravity. Its length is known: a vertical acceleration that the scans show is the sensors', and what the filter
/// believed to have learnt of gravity's length would be lost for them.
pub(crate) fn add_gravity_variance(covariance: &mut Covariance, gravity: &Vector3<f64>, variance: f64) {
    let up = gravity / gravity.norm();
    let mut block = covariance.fixed_view_mut::<3, 3>(at::GRAVITY, at::GRAVITY);
    block += (Matrix3::identity() - up * up.transpose()) * variance;
}

/// Copies what is known of older sections' places among each other and to the current one.
pub(crate) fn copy_places(from: &Covariance, to: &mut Covariance) {
    let places = from.fixed_view::<PLACES, PLACES>(at::CLONES, at::CLONES);
    to.fixed_view_mut::<PLACES, PLACES>(at::CLONES, at::CLONES).copy_from(&places);
}

/// Takes errors of older sections' places for ones that have nothing to do with those of motion and sensors.
pub(crate) fn uncouple_places(covariance: &mut Covariance) {
    covariance.fixed_view_mut::<OWN, PLACES>(0, at::CLONES).fill(0.0);
    covariance.fixed_view_mut::<PLACES, OWN>(at::CLONES, 0).fill(0.0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_keeps_its_norm_and_a_rotation_error_acts_in_the_imu_frame() {
        let state = State { rotation: exp_so3(&Vector3::new(0.0, 0.0, 1.0)), ..State::at_origin() };
        let mut d = Error::zeros();
        d[at::ROTATION] = 0.1;
        d[at::GRAVITY] = 0.5;
        let moved = state.plus(&d);
        assert!((moved.gravity.norm() - STANDARD_GRAVITY).abs() < 1e-12 && moved.gravity.x > 0.4);
        let turn = state.rotation.inverse() * moved.rotation;
        assert!((turn.scaled_axis() - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-12);
    }
}
