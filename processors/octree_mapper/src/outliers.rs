//! Radius outlier removal (paper section 3.1, filter 1).

use crate::OutlierConfig;

/// Ends a chain.
const NONE: u32 = u32::MAX;
/// Range at which the search radius equals a cell: most indoor points are nearer and look at 27 cells at most.
const CELL_RANGE_M: f64 = 10.0;
/// Range from which the radius grows no further, so that a lonely point looks at no more than some 700 cells. The
/// map's hits end nearer.
const LAST_RANGE_M: f32 = 40.0;

/// Removes points with too few others in reach. Exact: every point's neighbours are counted in a sphere, with the
/// radius of that point's own range. O(n) with buffers that are reused.
#[derive(Debug)]
pub struct RadiusOutlierFilter {
    config: OutlierConfig,
    cell: f32,
    /// First point of each bucket of the hash table; its length is a power of two.
    heads: Vec<u32>,
    /// Next point of the same bucket.
    next: Vec<u32>,
    cells: Vec<[i32; 3]>,
    inliers: Vec<bool>,
}

impl RadiusOutlierFilter {
    /// A filter whose buffers hold `capacity` points before they grow.
    pub fn new(config: OutlierConfig, capacity: usize) -> Self {
        Self {
            cell: (config.radius_m + CELL_RANGE_M * config.radius_per_m) as f32,
            config,
            heads: Vec::with_capacity(buckets(capacity)),
            next: Vec::with_capacity(capacity),
            cells: Vec::with_capacity(capacity),
            inliers: Vec::with_capacity(capacity),
        }
    }

    /// One flag a point: whether it has at least `min_neighbours` others within its radius. Points are finite, in
    /// metres in the LiDAR frame, whose origin the range is measured from.
    pub fn inliers(&mut self, points: &[[f32; 3]]) -> &[bool] {
        self.inliers.clear();
        if self.config.enabled {
            self.index(points);
            for (i, point) in points.iter().enumerate() {
                let inlier = self.has_neighbours(points, i, *point);
                self.inliers.push(inlier);
            }
        } else {
            self.inliers.resize(points.len(), true);
        }
        &self.inliers
    }

    fn index(&mut self, points: &[[f32; 3]]) {
        self.heads.clear();
        self.heads.resize(buckets(points.len()), NONE);
        self.next.clear();
        self.cells.clear();
        for (i, point) in points.iter().enumerate() {
            let cell = point.map(|x| (x / self.cell).floor() as i32);
            let bucket = self.bucket(cell);
            self.next.push(self.heads[bucket]);
            self.heads[bucket] = i as u32;
            self.cells.push(cell);
        }
    }

    fn has_neighbours(&self, points: &[[f32; 3]], i: usize, point: [f32; 3]) -> bool {
        let range = point.iter().map(|x| x * x).sum::<f32>().sqrt();
        let radius = self.config.radius_m as f32 + self.config.radius_per_m as f32 * range.min(LAST_RANGE_M);
        let own = self.cells[i];
        let mut missing = self.config.min_neighbours;
        // The own cell first: on a surface it settles the matter.
        if self.count_in(points, i, point, own, radius, &mut missing) {
            return true;
        }
        let low = point.map(|x| ((x - radius) / self.cell).floor() as i32);
        let high = point.map(|x| ((x + radius) / self.cell).floor() as i32);
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let cell = [x, y, z];
                    if cell != own && self.count_in(points, i, point, cell, radius, &mut missing) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Takes the neighbours in one cell off `missing`; true when enough were found.
    fn count_in(
        &self,
        points: &[[f32; 3]],
        i: usize,
        point: [f32; 3],
        cell: [i32; 3],
        radius: f32,
        missing: &mut u32,
    ) -> bool {
        let mut other = self.heads[self.bucket(cell)];
        while other != NONE {
            let o = other as usize;
            if o != i && self.cells[o] == cell && distance_squared(points[o], point) <= radius * radius {
                *missing -= 1;
                if *missing == 0 {
                    return true;
                }
            }
            other = self.next[o];
        }
        false
    }

    fn bucket(&self, cell: [i32; 3]) -> usize {
        let hash = cell.iter().fold(0u64, |hash, axis| {
            (hash.rotate_left(21) ^ u64::from(*axis as u32)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        });
        (hash >> 32) as usize & (self.heads.len() - 1)
    }
}

fn buckets(points: usize) -> usize {
    (2 * points).next_power_of_two().max(16)
}

fn distance_squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::Random;

    fn filter(config: OutlierConfig) -> RadiusOutlierFilter {
        RadiusOutlierFilter::new(config, 0)
    }

    /// A wall x = `range` seen by a 38.4 degree cone of 10,000 evenly spread rays, its normal turned by `turn_deg`.
    fn wall(range: f32, turn_deg: f32, random: &mut Random) -> Vec<[f32; 3]> {
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let half = 19.2f32.to_radians();
        (0..10_000)
            .filter_map(|i| {
                let (angle, off) = (i as f32 * 2.399_963, half * ((i as f32 + 0.5) / 10_000.0).sqrt());
                let ray = [off.cos(), off.sin() * angle.cos(), off.sin() * angle.sin()];
                let length = range * cos / (ray[0] * cos + ray[1] * sin);
                (0.5..40.0).contains(&length).then(|| ray.map(|x| x * (length + 0.02 * random.gauss())))
            })
            .collect()
    }

    #[test]
    fn the_grid_counts_the_same_neighbours_as_comparing_every_pair() {
        let mut random = Random::new(5);
        let config = OutlierConfig { radius_m: 0.2, radius_per_m: 0.05, min_neighbours: 4, enabled: true };
        let points: Vec<[f32; 3]> =
            (0..3000).map(|_| std::array::from_fn(|_| random.between(-6.0, 14.0))).collect();
        let expected: Vec<bool> = points
            .iter()
            .map(|a| {
                let radius = 0.2 + 0.05 * a.iter().map(|x| x * x).sum::<f32>().sqrt();
                points.iter().filter(|b| distance_squared(*a, **b) <= radius * radius).count() > 4
            })
            .collect();
        assert!(expected.iter().any(|x| *x) && expected.iter().any(|x| !*x));
        assert_eq!(filter(config).inliers(&points), expected);
    }

    #[test]
    fn isolated_strays_in_the_air_are_removed_at_every_range() {
        let mut random = Random::new(1);
        let mut points = wall(12.0, 0.0, &mut random);
        let strays = [[2.0, 0.1, 0.1], [4.0, -0.5, 0.3], [7.0, 1.0, -1.0], [10.5, -2.0, 1.0]];
        points.extend(strays);
        let mut filter = filter(OutlierConfig::default());
        let inliers = filter.inliers(&points);
        assert_eq!(&inliers[10_000..], [false; 4]);
        assert!(inliers[..10_000].iter().all(|x| *x), "every point of the wall stays");
    }

    #[test]
    fn a_far_wall_and_a_wall_at_a_grazing_angle_stay() {
        let mut random = Random::new(2);
        for (range, turn, least) in [(35.0, 0.0, 1.0), (10.0, 70.0, 0.98), (3.0, 80.0, 0.9)] {
            let points = wall(range, turn, &mut random);
            let mut filter = filter(OutlierConfig::default());
            let kept = filter.inliers(&points).iter().filter(|x| **x).count();
            assert!(
                kept as f64 >= least * points.len() as f64,
                "{range} m, {turn} deg: {kept} of {}",
                points.len()
            );
        }
    }

    #[test]
    fn points_at_one_place_are_neighbours_of_each_other_but_not_of_themselves() {
        let mut filter = filter(OutlierConfig { min_neighbours: 2, ..Default::default() });
        assert_eq!(filter.inliers(&[[1.0; 3]; 3]), [true; 3]);
        assert_eq!(filter.inliers(&[[1.0; 3]; 2]), [false; 2]);
        assert!(filter.inliers(&[]).is_empty());
    }
}
