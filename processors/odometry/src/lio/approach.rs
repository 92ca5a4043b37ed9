//! A pose that was found again is come back to in steps: whoever follows the poses sees no jump.

use evac_frames::PoseFrame;
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_geometry::{map_from_imu, set_map_from_imu, set_map_from_lidar};

/// Largest step of a published position beyond the motion that the IMU integrated, metres.
const MAX_STEP: f64 = 0.2;

/// How far published positions still are from the filter's own.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Approach {
    /// The last frame's published position of the IMU; nothing where there was none.
    last: Option<Vector3<f64>>,
}

impl Approach {
    /// Forgets where the last pose was published: the map frame is a new one.
    pub(crate) fn restart(&mut self) {
        self.last = None;
    }

    /// Keeps the position of `pose` within a step of where `moved`, the motion by the IMU alone, leads to from the last one;
    /// returns whether it is still on its way.
    pub(crate) fn limit(
        &mut self,
        pose: &mut PoseFrame,
        moved: &Vector3<f64>,
        imu_from_lidar: &Isometry3<f64>,
    ) -> bool {
        let own = map_from_imu(pose);
        let expected = self.last.map_or(own.translation.vector, |last| last + moved);
        let off = own.translation.vector - expected;
        let is_on_its_way = off.norm() > MAX_STEP;
        let mut published = own;
        if is_on_its_way {
            published.translation.vector = expected + off * (MAX_STEP / off.norm());
            set_map_from_imu(pose, &published);
            set_map_from_lidar(pose, &(published * imu_from_lidar));
            for (axis, rest) in (own.translation.vector - published.translation.vector).iter().enumerate() {
                if let Some(variance) = pose.covariance.get_mut(axis * 7) {
                    *variance += rest * rest;
                }
            }
        }
        self.last = Some(published.translation.vector);
        is_on_its_way
    }
}

#[cfg(test)]
mod tests {
    use evac_geometry::map_from_lidar;

    use super::*;

    #[test]
    fn a_pose_that_is_found_a_metre_away_is_come_back_to_without_a_jump() {
        let rig = Isometry3::translation(0.05, 0.0, 0.1);
        let mut approach = Approach::default();
        // Walks on at 0.1 m a frame; from the third frame on it knows that it is a metre further left.
        let walk = Vector3::new(0.1, 0.0, 0.0);
        let mut before: Option<Vector3<f64>> = None;
        let mut on_its_way = 0;
        for frame in 0..12 {
            let left = if frame < 3 { 0.0 } else { 1.0 };
            let mut pose = PoseFrame::default();
            set_map_from_imu(&mut pose, &Isometry3::translation(0.1 * f64::from(frame), left, 0.0));
            let own = map_from_imu(&pose);
            set_map_from_lidar(&mut pose, &(own * rig));
            on_its_way += u32::from(approach.limit(&mut pose, &walk, &rig));
            let place = map_from_lidar(&pose).translation.vector;
            let step = before.map_or(walk, |before| place - before);
            assert!((step - walk).norm() < MAX_STEP + 1e-9, "{frame}: {step}");
            assert!((place - map_from_imu(&pose).translation.vector - rig.translation.vector).norm() < 1e-12);
            before = Some(place);
        }
        assert_eq!(on_its_way, 4);
        assert!((before.unwrap() - Vector3::new(1.15, 1.0, 0.1)).norm() < 1e-9);
    }
}
