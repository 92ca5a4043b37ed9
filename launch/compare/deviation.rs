//! How far two instances' outputs for one frame are apart.

use std::collections::HashMap;

use evac_frames::{Point, PoseFrame, Voxel};
use evac_geometry::map_from_lidar;

use super::report::Measures;

pub(super) const POSES: Measures =
    Measures { keys: ["position_mm", "rotation_deg"], labels: ["position (mm)", "rotation (deg)"] };
pub(super) const SCANS: Measures =
    Measures { keys: ["points_rms_mm", "points_max_mm"], labels: ["points, rms (mm)", "points, max (mm)"] };
pub(super) const MAPS: Measures = Measures {
    keys: ["voxels_differing", "share_percent"],
    labels: ["voxels that differ", "of all changed (%)"],
};

/// Millimetres and degrees.
pub(super) fn of_poses(a: &PoseFrame, b: &PoseFrame) -> [f64; 2] {
    let (a, b) = (map_from_lidar(a), map_from_lidar(b));
    let way = (a.translation.vector - b.translation.vector).norm();
    [way * 1e3, a.rotation.angle_to(&b.rotation).to_degrees()]
}

/// Millimetres, root mean square and largest, over the points that both have; nothing where they are not the same shots.
pub(super) fn of_scans(a: &[Point], b: &[Point]) -> Option<[f64; 2]> {
    if a.len() != b.len() || a.is_empty() {
        return None;
    }
    let squared = a.iter().zip(b).map(|(a, b)| {
        let d = [a.x - b.x, a.y - b.y, a.z - b.z].map(f64::from);
        d.iter().map(|d| d * d).sum::<f64>()
    });
    let (sum, max) = squared.fold((0.0, 0.0_f64), |(sum, max), d| (sum + d, max.max(d)));
    Some([(sum / a.len() as f64).sqrt() * 1e3, max.sqrt() * 1e3])
}

/// Two maps as far as they have changed since the comparison began.
#[derive(Debug, Default)]
pub(super) struct Maps {
    /// The value of each side, where it has said one.
    voxels: HashMap<[u16; 3], [Option<(u32, u16)>; 2]>,
    differing: u64,
}

impl Maps {
    /// Takes the updates of one frame in; gives the voxels that differ and their share in percent.
    pub(super) fn of_updates(&mut self, a: &[Voxel], b: &[Voxel]) -> [f64; 2] {
        for (side, voxels) in [a, b].into_iter().enumerate() {
            for voxel in voxels {
                let sides = self.voxels.entry(voxel.key).or_default();
                let before = sides[0] != sides[1];
                if let Some(place) = sides.get_mut(side) {
                    *place = Some((voxel.log_odds.to_bits(), voxel.flags));
                }
                let after = sides[0] != sides[1];
                self.differing = self.differing + u64::from(after) - u64::from(before);
            }
        }
        let all = self.voxels.len().max(1) as f64;
        [self.differing as f64, self.differing as f64 / all * 100.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_scans_are_not_apart_and_a_shifted_one_is_by_its_shift() {
        let scan =
            |shift: f32| (0..10).map(|i| Point::new(i as f32 + shift, 2.0, 3.0, 0, 9)).collect::<Vec<_>>();
        assert_eq!(of_scans(&scan(0.0), &scan(0.0)), Some([0.0, 0.0]));
        let [rms, max] = of_scans(&scan(0.0), &scan(0.25)).unwrap();
        assert!((rms - 250.0).abs() < 0.1 && (max - 250.0).abs() < 0.1);
        assert_eq!(of_scans(&scan(0.0), &scan(0.0)[1..]), None);
    }

    #[test]
    fn voxels_differ_until_the_other_map_says_the_same() {
        let voxel = |x: u16, log_odds: f32| Voxel { key: [x, 0, 0], log_odds, ..Voxel::default() };
        let mut maps = Maps::default();
        assert_eq!(maps.of_updates(&[voxel(1, 0.5), voxel(2, 0.5)], &[voxel(1, 0.5)]), [1.0, 50.0]);
        assert_eq!(maps.of_updates(&[], &[voxel(2, 0.5)]), [0.0, 0.0]);
        assert_eq!(maps.of_updates(&[voxel(1, 0.8)], &[]), [1.0, 50.0]);
    }
}
