//! Which scans go into the map (paper section 3.2: the global map is updated at a lower rate).

use evac_geometry::nalgebra::Isometry3;
use evac_stage::{StageError, State};

use crate::KeyFrameConfig;
use crate::memory::{load_pose, save_pose};

/// Chooses key frames by way, rotation and time since the last one.
#[derive(Debug)]
pub struct KeyFrames {
    config: KeyFrameConfig,
    last: Option<(i64, Isometry3<f64>)>,
}

impl KeyFrames {
    /// Without a key frame yet: the first pose becomes one.
    pub fn new(config: KeyFrameConfig) -> Self {
        Self { config, last: None }
    }

    pub(crate) fn save(&self, state: &mut State) {
        state.put(u64::from(self.last.is_some()));
        if let Some((end_ns, pose)) = &self.last {
            state.put(end_ns.cast_unsigned());
            save_pose(state, pose);
        }
    }

    pub(crate) fn load(&mut self, state: &mut State) -> Result<(), StageError> {
        self.last = match state.number()? {
            0 => None,
            _ => Some((state.number()?.cast_signed(), load_pose(state)?)),
        };
        Ok(())
    }

    /// Another mapper has chosen the scan that ended at `end_ns` with this pose.
    pub fn adopt(&mut self, end_ns: i64, map_from_lidar: &Isometry3<f64>) {
        self.last = Some((end_ns, *map_from_lidar));
    }

    /// Whether the scan that ended at `end_ns` with this pose is a key frame; if so the next ones are compared with it.
    pub fn choose(&mut self, end_ns: i64, map_from_lidar: &Isometry3<f64>) -> bool {
        let chosen = self.last.is_none_or(|(last_ns, last)| {
            let way = (map_from_lidar.translation.vector - last.translation.vector).norm();
            let angle = last.rotation.angle_to(&map_from_lidar.rotation);
            // A clock that jumped back starts a new segment: the absolute value takes it as a new key frame.
            let time_s = (end_ns.saturating_sub(last_ns)).unsigned_abs() as f64 * 1e-9;
            way >= self.config.distance_m
                || angle >= self.config.angle_deg.to_radians()
                || time_s >= self.config.interval_s
        });
        if chosen {
            self.last = Some((end_ns, *map_from_lidar));
        }
        chosen
    }
}

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::Vector3;

    use super::*;

    const FRAME_NS: i64 = 100_000_000;

    /// Indices of the key frames of ten seconds at 10 Hz of even motion.
    fn chosen(config: KeyFrameConfig, way_m: f64, yaw_deg: f64) -> Vec<i64> {
        let mut key_frames = KeyFrames::new(config);
        (0..100)
            .filter(|i| {
                let share = *i as f64;
                let turn = Vector3::z() * (share * yaw_deg).to_radians();
                key_frames.choose(i * FRAME_NS, &Isometry3::new(Vector3::x() * (share * way_m), turn))
            })
            .collect()
    }

    #[test]
    fn at_rest_a_key_frame_comes_every_half_second() {
        assert_eq!(chosen(KeyFrameConfig::default(), 0.0, 0.0)[..4], [0, 5, 10, 15]);
    }

    #[test]
    fn walking_and_turning_bring_them_sooner() {
        let config = KeyFrameConfig { interval_s: 100.0, ..Default::default() };
        assert_eq!(chosen(config, 0.0, 0.0), [0]);
        assert_eq!(chosen(config, 0.13, 0.0)[..4], [0, 2, 4, 6]);
        assert_eq!(chosen(config, 0.0, 4.1)[..4], [0, 2, 4, 6]);
        assert_eq!(chosen(config, 0.1, 0.0)[..4], [0, 3, 6, 9]);
    }

    #[test]
    fn a_clock_that_jumps_back_starts_over() {
        let mut key_frames = KeyFrames::new(KeyFrameConfig::default());
        let pose = Isometry3::identity();
        assert!(key_frames.choose(i64::MAX, &pose));
        assert!(key_frames.choose(i64::MIN, &pose));
        assert!(!key_frames.choose(i64::MIN + FRAME_NS, &pose));
    }
}
