//! What a calibration corrects, and a walk with it applied.

use evac_config::ImuFromLidar;
use evac_experiments::Walk;
use evac_frames::ImuSample;
use evac_geometry::nalgebra::Vector3;
use evac_geometry::{exp_so3, log_so3};
use evac_stage::Rig;

/// How the IMU differs from what the rig's file and the stamps say.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Correction {
    /// Rotation vector from the axes that the IMU really has to those that the rig's file gives it, rad.
    pub misalignment: Vector3<f64>,
    /// A true rate `w` reads `(1 + scale) w + bias`, IMU axes.
    pub gyro_scale: Vector3<f64>,
    /// rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Seconds to add to an IMU stamp to get LiDAR time.
    pub time_offset_s: f64,
}

impl Correction {
    /// The rig as the correction says that it is: `v_given = Exp(m) v_true`, so `R_true = Exp(-m) R_given`. The lever arm
    /// stays.
    pub fn rig(&self, given: &Rig) -> Rig {
        let rotation = exp_so3(&-self.misalignment) * given.imu_from_lidar().rotation;
        let (roll, pitch, yaw) = rotation.euler_angles();
        Rig {
            imu_from_lidar: ImuFromLidar {
                roll_pitch_yaw_deg: [roll, pitch, yaw].map(f64::to_degrees),
                ..given.imu_from_lidar
            },
        }
    }

    /// The walk with rig, stamps and rates put right. The bias stays in: the odometry finds it at the start.
    pub(crate) fn applied(&self, walk: &Walk) -> Walk {
        let offset_ns = (self.time_offset_s * 1e9).round() as i64;
        let correct = |mut sample: ImuSample| {
            sample.stamp_ns = sample.stamp_ns.saturating_add(offset_ns);
            for (rate, scale) in sample.gyro.iter_mut().zip(self.gyro_scale.iter()) {
                *rate /= 1.0 + scale;
            }
            sample
        };
        let imu: Vec<_> = walk.imu().into_iter().map(correct).collect();
        Walk { rig: self.rig(&walk.rig), ..walk.with_imu(&imu) }
    }

    /// This correction followed by another one that was found with it applied.
    pub(crate) fn then(&self, next: &Self) -> Self {
        let rotation = exp_so3(&self.misalignment) * exp_so3(&next.misalignment);
        Self {
            misalignment: log_so3(&rotation),
            gyro_scale: self.gyro_scale + next.gyro_scale + self.gyro_scale.component_mul(&next.gyro_scale),
            gyro_bias: next.gyro_bias,
            time_offset_s: self.time_offset_s + next.time_offset_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_correction_after_another_is_the_rig_with_both() {
        let given = Rig {
            imu_from_lidar: ImuFromLidar {
                translation_m: [0.1, 0.2, 0.3],
                roll_pitch_yaw_deg: [1.0, 2.0, 3.0],
            },
        };
        let turned = |x: f64, y: f64, z: f64| Correction {
            misalignment: Vector3::new(x, y, z),
            time_offset_s: x,
            ..Correction::default()
        };
        let (first, second) = (turned(0.1, -0.2, 0.05), turned(0.02, 0.1, -0.3));
        let both = first.then(&second);
        let [one, other] = [second.rig(&first.rig(&given)), both.rig(&given)].map(|rig| rig.imu_from_lidar());
        assert!(one.rotation.angle_to(&other.rotation) < 1e-12);
        assert_eq!(one.translation, other.translation);
        assert!((both.time_offset_s - 0.12).abs() < 1e-15);
    }
}
