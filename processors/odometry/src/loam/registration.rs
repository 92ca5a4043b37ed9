//! Iterative pose optimisation: scan to map, point to line and point to plane (paper, section III).

use evac_geometry::nalgebra::{Isometry3, SVector};

use super::centroid_map::CentroidMap;
use super::config::LoamConfig;
use super::features::{Feature, Features};
use super::filter::{Filter, POSITION, PoseError, PoseInformation, ROTATION, STATES};
use super::observability::{Degeneracy, remap};
use super::shape::Shape;
use super::sweep::{Path, Sweep};

/// Points of one scan are not independent: each says so many times less than its noise promises.
const INFLATION: f64 = 10.0;
/// Standard deviation of a map voxel's mean, metres.
const MAP_NOISE: f64 = 0.01;
/// Rounds before the largest residuals are taken for outliers (paper: 2).
const PRERUN: usize = 2;
/// Largest residual in those and in the later rounds, metres.
const GATES: [f64; 2] = [0.3, 0.12];
/// Residual from which on a point pulls no stronger in those rounds (Huber), metres: what is off by a wrong prediction must not
/// be taken for an outlier yet.
const HUBER: f64 = 0.1;
/// Squared scale of the Cauchy weight of the later rounds, in units of the noise.
const CAUCHY_SQUARED: f64 = 4.0;
/// The outliers' threshold is never below this multiple of the noise.
const INLIER_FLOOR: f64 = 1.5;
/// A step smaller than this ends the iteration, metres and radians.
const CONVERGED: f64 = 1e-4;
/// Neighbouring voxels that are searched: a line fills fewer of them than a plane.
const SURFACE_REACH: i64 = 1;
const EDGE_REACH: i64 = 2;

/// What the match found.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Report {
    /// Features that went to the match, that have map around them, and that it used.
    pub(crate) selected: usize,
    pub(crate) in_view: usize,
    pub(crate) used: usize,
    /// Root mean square of the used residuals, metres.
    pub(crate) residual: f64,
    /// About the pose, observed directions only.
    pub(crate) information: PoseInformation,
    /// Directions of translation that were not observed.
    pub(crate) degeneracy: Degeneracy,
    /// Correction of the prior.
    pub(crate) correction: SVector<f64, STATES>,
}

impl Report {
    /// The match is not believed: it observed nothing and corrects nothing.
    pub(crate) fn refuse(&mut self) {
        self.used = 0;
        self.information.fill(0.0);
        self.correction.fill(0.0);
        self.degeneracy = Degeneracy::nothing_observed();
    }
}

/// The match with its buffers, allocated once.
#[derive(Debug)]
pub(crate) struct Registration {
    rows: Vec<Row>,
    magnitudes: Vec<f64>,
    max_features: [usize; 2],
    iterations: usize,
    outlier_share: f64,
    variance: f64,
}

/// One residual and what it depends on.
#[derive(Debug, Clone, Copy)]
struct Row {
    residual: f64,
    jacobian: PoseError,
}

impl Registration {
    pub(crate) fn new(config: &LoamConfig) -> Self {
        let max_features = [config.max_surface_features, config.max_edge_features].map(|max| max as usize);
        let capacity = max_features.iter().sum();
        Self {
            rows: Vec::with_capacity(capacity),
            magnitudes: Vec::with_capacity(capacity),
            max_features,
            iterations: config.iterations as usize,
            outlier_share: config.outlier_share,
            variance: config.range_noise_m.powi(2) + MAP_NOISE.powi(2),
        }
    }

    /// Matches the features with the map from the filter's pose on; the filter is not changed.
    pub(crate) fn align(
        &mut self,
        (surface_map, edge_map): (&CentroidMap, &CentroidMap),
        features: &Features,
        imu_from_lidar: &Isometry3<f64>,
        filter: &Filter,
        sweep: &Sweep,
    ) -> Report {
        let mut report = Report::default();
        let mut offset = PoseError::zeros();
        let mut limit = f64::INFINITY;
        for round in 0..self.iterations {
            let path = Path::new(sweep, filter.moved(&offset));
            let gate = if round < PRERUN { GATES[0] } else { GATES[1] }.min(limit);
            self.rows.clear();
            (report.selected, report.in_view) = (0, 0);
            for (list, map, is_line) in
                [(&features.surfaces, surface_map, false), (&features.edges, edge_map, true)]
            {
                let max = self.max_features[usize::from(is_line)];
                let stride = list.len().div_ceil(max.max(1)).max(1);
                for feature in list.iter().step_by(stride).take(max) {
                    report.selected += 1;
                    let row = self.row(feature, map, is_line, imu_from_lidar, &path);
                    report.in_view += usize::from(row.is_some());
                    self.rows.extend(row.filter(|row| row.residual.abs() < gate));
                }
            }
            if round + 1 == PRERUN {
                limit = self.outlier_limit();
            }
            let (mut information, mut vector) = self.normal_equations(round < PRERUN, &mut report);
            report.degeneracy = Degeneracy::of(&information);
            // Without IMU the prior is too weak to hold a direction by itself; the original has no such step either.
            if sweep.deskewed {
                remap(&mut information, &mut vector);
            }
            report.information = information;
            let Some(d) = filter.correction(&information, &vector, &offset) else { break };
            report.correction = d;
            let new = d.fixed_rows::<6>(0).into_owned();
            let step = (new - offset).amax();
            offset = new;
            if step < CONVERGED && round >= PRERUN {
                break;
            }
        }
        report
    }

    fn row(
        &self,
        feature: &Feature,
        map: &CentroidMap,
        is_line: bool,
        imu_from_lidar: &Isometry3<f64>,
        path: &Path,
    ) -> Option<Row> {
        let in_imu = imu_from_lidar.rotation * feature.point + imu_from_lidar.translation.vector;
        let (share, arm, place) = path.place(&in_imu, feature.offset_ns);
        let shape = if is_line {
            Shape::line(&map.nearest(&place, EDGE_REACH)?)?
        } else {
            Shape::plane(&map.nearest(&place, SURFACE_REACH)?)?
        };
        let (residual, direction) = shape.residual(&place);
        let mut jacobian = PoseError::zeros();
        jacobian.fixed_rows_mut::<3>(POSITION).copy_from(&(direction * share));
        jacobian.fixed_rows_mut::<3>(ROTATION).copy_from(&(arm.cross(&direction) * share));
        Some(Row { residual, jacobian })
    }

    /// The residual above which the configured share of them lies (paper: the largest 20 %).
    fn outlier_limit(&mut self) -> f64 {
        self.magnitudes.clear();
        self.magnitudes.extend(self.rows.iter().map(|row| row.residual.abs()));
        let kept = (self.magnitudes.len() as f64 * (1.0 - self.outlier_share)) as usize;
        if kept >= self.magnitudes.len() {
            return f64::INFINITY;
        }
        let (_, limit, _) = self.magnitudes.select_nth_unstable_by(kept, f64::total_cmp);
        limit.max(INLIER_FLOOR * self.variance.sqrt())
    }

    fn normal_equations(&self, prerun: bool, report: &mut Report) -> (PoseInformation, PoseError) {
        let (mut information, mut vector) = (PoseInformation::zeros(), PoseError::zeros());
        let mut squares = 0.0;
        for row in &self.rows {
            let squared = row.residual * row.residual / self.variance;
            let robust = if prerun {
                (HUBER / row.residual.abs()).min(1.0)
            } else {
                1.0 / (1.0 + squared / CAUCHY_SQUARED)
            };
            let weight = robust / (INFLATION * self.variance);
            let weighted = row.jacobian * weight;
            information += weighted * row.jacobian.transpose();
            vector -= weighted * row.residual;
            squares += row.residual * row.residual;
        }
        report.used = self.rows.len();
        report.residual = (squares / self.rows.len().max(1) as f64).sqrt();
        (information, vector)
    }
}

#[cfg(test)]
mod tests {
    use evac_geometry::nalgebra::Vector3;

    use super::*;

    /// Surface features and map of a room of 6 x 4 x 3 m seen from its middle.
    fn room() -> (Features, CentroidMap) {
        let config = LoamConfig::default();
        let (mut features, mut map) = (Features::new(&config), CentroidMap::new(0.3, 1 << 14, 50.0, 30.0));
        for axis in 0..3 {
            let half = [3.0, 2.0, 1.5];
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [-1.0, 1.0] {
                for i in 0..60 {
                    for j in 0..60 {
                        let mut point = Vector3::zeros();
                        point[axis] = side * half[axis];
                        point[u] = (f64::from(i) / 30.0 - 0.98) * half[u];
                        point[v] = (f64::from(j) / 30.0 - 0.98) * half[v];
                        map.insert(&point);
                        if (i + j) % 7 == 0 {
                            features.surfaces.push(Feature { point, offset_ns: 50_000_000 });
                        }
                    }
                }
            }
        }
        (features, map)
    }

    fn sweep(deskewed: bool) -> Sweep {
        Sweep { from: Isometry3::identity(), start_ns: 0, end_ns: 100_000_000, deskewed }
    }

    fn align(features: &Features, map: &CentroidMap, sweep: &Sweep) -> Report {
        let mut filter = Filter::new(0, &Isometry3::identity(), 1.0, 0.1);
        filter.add_variance(POSITION, 0.04);
        let edges = CentroidMap::new(0.2, 1024, 50.0, 30.0);
        let mut registration = Registration::new(&LoamConfig::default());
        registration.align((map, &edges), features, &Isometry3::identity(), &filter, sweep)
    }

    #[test]
    fn a_displaced_scan_is_brought_back_to_the_map() {
        let (mut features, map) = room();
        let displaced = Isometry3::new(Vector3::new(0.08, -0.05, 0.03), Vector3::new(0.01, -0.02, 0.03));
        for feature in &mut features.surfaces {
            feature.point = displaced.inverse_transform_point(&feature.point.into()).coords;
        }
        let report = align(&features, &map, &sweep(true));
        let found = report.correction;
        assert!((found.fixed_rows::<3>(0) - displaced.translation.vector).norm() < 5e-3, "{found}");
        assert!((found.fixed_rows::<3>(3) - displaced.rotation.scaled_axis()).norm() < 3e-3, "{found}");
        assert!(report.used * 10 > report.selected * 7 && report.degeneracy.count == 0, "{report:?}");
    }

    #[test]
    fn a_point_from_the_middle_of_the_frame_moves_the_pose_at_its_end_twice_as_far() {
        let (mut features, map) = room();
        features.surfaces.iter_mut().for_each(|feature| feature.point.x -= 0.03);
        let found = align(&features, &map, &sweep(false)).correction;
        assert!((found[0] - 0.06).abs() < 3e-3, "{found}");
    }

    #[test]
    fn a_person_before_the_wall_does_not_pull() {
        let (mut features, map) = room();
        for feature in features.surfaces.iter_mut().filter(|f| f.point.x > 2.9 && f.point.y.abs() < 0.4) {
            feature.point.x -= 0.2;
        }
        let found = align(&features, &map, &sweep(true)).correction;
        assert!(found.fixed_rows::<3>(0).norm() < 5e-3, "{found}");
    }

    #[test]
    fn without_a_map_the_prior_stands() {
        let (features, _) = room();
        let report = align(&features, &CentroidMap::new(0.3, 1024, 50.0, 30.0), &sweep(true));
        assert_eq!((report.in_view, report.used, report.degeneracy.count), (0, 0, 3));
        assert_eq!(report.correction.norm(), 0.0);
    }
}
