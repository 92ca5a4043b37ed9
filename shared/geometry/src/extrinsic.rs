//! The rig's extrinsic (paper Eq. 1-3).

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// `R = Rz(gamma) Ry(beta) Rx(alpha)`, paper Eq. 1, angles in radians, counterclockwise positive.
pub fn rotation_from_euler(alpha: f64, beta: f64, gamma: f64) -> Rotation3<f64> {
    let ((sa, ca), (sb, cb), (sg, cg)) = (alpha.sin_cos(), beta.sin_cos(), gamma.sin_cos());
    Rotation3::from_matrix_unchecked(Matrix3::new(
        cb * cg,
        sa * sb * cg - ca * sg,
        ca * sb * cg + sa * sg,
        cb * sg,
        sa * sb * sg + ca * cg,
        ca * sb * sg - sa * cg,
        -sb,
        sa * cb,
        ca * cb,
    ))
}

/// Transform from LiDAR to IMU coordinates, paper Eq. 3: lever arm in metres and roll, pitch, yaw in degrees.
pub fn imu_from_lidar(translation_m: [f64; 3], roll_pitch_yaw_deg: [f64; 3]) -> Isometry3<f64> {
    let [roll, pitch, yaw] = roll_pitch_yaw_deg.map(f64::to_radians);
    Isometry3::from_parts(
        Translation3::from(Vector3::from(translation_m)),
        UnitQuaternion::from_rotation_matrix(&rotation_from_euler(roll, pitch, yaw)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_angles_multiply_as_rz_ry_rx() {
        let (a, b, c) = (0.3, -0.7, 2.1);
        let product = Rotation3::from_axis_angle(&Vector3::z_axis(), c)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), a);
        assert!((rotation_from_euler(a, b, c).matrix() - product.matrix()).norm() < 1e-15);
    }

    #[test]
    fn a_quarter_turn_about_z_takes_lidar_x_to_imu_y_and_adds_the_lever_arm() {
        let transform = imu_from_lidar([0.1, 0.2, 0.3], [0.0, 0.0, 90.0]);
        let point = transform * nalgebra::Point3::new(1.0, 0.0, 0.0);
        assert!((point.coords - Vector3::new(0.1, 1.2, 0.3)).norm() < 1e-12);
    }
}
