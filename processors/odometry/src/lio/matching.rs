//! Which plane a point lies on (design section 5.5).

use evac_geometry::nalgebra::{Isometry3, Point3, SVector, Vector3};

use super::cell::POINT_FLOOR;
use super::drift::Piece;
use super::offset::PoseCovariance;
use super::plane_map::PlaneMap;
use super::sections::{SectionId, Sections};
use super::state::{Covariance, State};
use super::voxel::{EDGES, Voxel};

/// Gate on the residual in standard deviations, squared.
const GATE_SQUARED: f64 = 9.0;
/// No extrapolation of a plane beyond the spread of its points.
const MAX_LEVERAGE: f64 = 12.0;
/// The wider the gate, the more planes a point might belong to (a door, the wall beside it): a plane is taken for uncertain by
/// this share of the variance of the pose before the match, so that one false plane is not believed at once and for good.
const DOUBT: f64 = 0.1;
/// A rough surface seen from elsewhere shows other bumps: a cell has about so many of them, and by their mean a point may be off.
const BUMPS: f64 = 8.0;

/// A selected point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Selected {
    /// In the IMU frame at the scan's end.
    pub(crate) point: Vector3<f64>,
    /// Unit vector from the LiDAR to the point, IMU frame.
    pub(crate) beam: Vector3<f64>,
}

/// A point with its plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    /// Section of the map that the plane belongs to: planes of one section share the error of its place.
    pub(crate) section: SectionId,
    /// Index of the plane's cell: matches of one cell share that plane and its error.
    pub(crate) cell: u32,
    /// Piece of ground that the cell belongs to.
    pub(crate) piece: Piece,
    /// Number of the point among those selected.
    order: u32,
    /// In the IMU frame.
    pub(crate) point: Vector3<f64>,
    /// Variance of the point along the normal, the gate's floor included: far off as yet, a point must not count as an
    /// outlier.
    pub(crate) point_variance: f64,
    /// Variance of the plane at the point, as far as its points share it. Scans that follow each other see the same bumps
    /// of a rough surface: these do not average out, so the whole roughness counts.
    pub(crate) plane_variance: f64,
}

impl Match {
    /// Section, cell and number in one.
    fn rank(&self) -> u128 {
        (u128::from(self.section) << 64) | (u128::from(self.cell) << 32) | u128::from(self.order)
    }
}

/// What is matched with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known<'a> {
    /// The map.
    pub(crate) map: &'a PlaneMap,
    /// Its sections.
    pub(crate) sections: &'a Sections,
}

/// How far from the pose at hand planes are looked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Search<'a> {
    /// Covariance of the pose before the match, and of all else.
    pub(crate) predicted: &'a PoseCovariance,
    pub(crate) covariance: &'a Covariance,
    /// The pose at hand is the predicted one.
    pub(crate) first: bool,
    /// Range noise, metres.
    pub(crate) range_noise: f64,
    /// Standard deviation added to every residual's, metres.
    pub(crate) gate_floor: f64,
}

/// How much of a scan sees what is mapped, in points.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct View {
    /// Those with a plane to be compared with.
    pub(crate) compared: usize,
    /// Those where much is mapped, planes or not: an edge or a bush shows nothing, but it is no new ground.
    pub(crate) known: usize,
}

/// Finds for every selected point the most certain plane whose residual passes the gate, coarse to fine and the first smooth one.
///
/// The covariance of the predicted pose widens the gate in the first association, the gate's floor in the loose mode.
pub(crate) fn associate(
    known: &Known<'_>,
    selected: &[Selected],
    state: &State,
    search: &Search<'_>,
    matches: &mut Vec<Match>,
) -> View {
    let Known { map, sections } = known;
    let Search { predicted, covariance, first, range_noise, gate_floor } = *search;
    matches.clear();
    let rotation = state.rotation.to_rotation_matrix();
    let mut view = View::default();
    // Neighbouring points mostly see the same section, and that the current one, whose place is exact.
    let here = sections.current();
    let mut recent = (here, PoseCovariance::zeros(), Isometry3::identity());
    for (order, candidate) in (0..).zip(selected) {
        let point = rotation * candidate.point + state.position;
        let beam = rotation * candidate.beam;
        let (mut seen, mut known) = (false, false);
        let mut best: Option<(f64, Match)> = None;
        let Some(voxel) = Voxel::of(&point) else { continue };
        for level in 0..EDGES.len() {
            let Some((index, cell)) = map.find(level, &voxel) else { continue };
            known = level + 1 == EDGES.len() && cell.is_ripe();
            let Some(plane) = cell.plane() else { continue };
            if cell.section != here && cell.section != recent.0 {
                let id = cell.section;
                recent = (
                    id,
                    sections.pose_covariance(id, state, covariance),
                    sections.place(id, state).inverse(),
                );
            }
            let is_here = cell.section == here;
            // In the map frame of the cell's section.
            let point = if is_here { point } else { (recent.2 * Point3::from(point)).coords };
            let leverage = plane.leverage(&point);
            if leverage > MAX_LEVERAGE {
                continue;
            }
            seen = true;
            let residual = plane.distance(&point);
            let incidence = beam.dot(&plane.normal);
            let point_variance = (range_noise * incidence).powi(2) + POINT_FLOOR + plane.roughness;
            let fit_variance = plane.variances[0] / plane.points * leverage;
            let total = point_variance + fit_variance + plane.roughness / BUMPS;
            if best.as_ref().is_some_and(|(least, _)| *least <= total) {
                continue;
            }
            let h =
                pose_row(&rotation.inverse_transform_vector(&plane.normal), &plane.normal, &candidate.point);
            let pose_variance = h.dot(&(predicted * h));
            let mut variance = total + gate_floor * gate_floor;
            variance += if is_here { 0.0 } else { h.dot(&(recent.1 * h)) };
            variance += if first { pose_variance } else { 0.0 };
            if residual * residual < GATE_SQUARED * variance {
                let matched = Match {
                    section: cell.section,
                    cell: index as u32,
                    piece: cell.piece,
                    order,
                    point: candidate.point,
                    point_variance: point_variance + gate_floor * gate_floor,
                    plane_variance: fit_variance + plane.roughness + pose_variance * DOUBT,
                };
                best = Some((total, matched));
                // Nothing finer is better than a large smooth plane.
                if plane.roughness == 0.0 {
                    break;
                }
            }
        }
        matches.extend(best.map(|(_, matched)| matched));
        view.compared += usize::from(seen);
        view.known += usize::from(seen || known);
    }
    // One section's and one cell's matches side by side, in an order that keeps sums reproducible.
    matches.sort_unstable_by_key(Match::rank);
    view
}

/// Derivative of a residual by rotation (right error) and position.
pub(crate) fn pose_row(
    normal_in_imu: &Vector3<f64>,
    normal: &Vector3<f64>,
    point: &Vector3<f64>,
) -> SVector<f64, 6> {
    let by_rotation = point.cross(normal_in_imu);
    SVector::from([by_rotation.x, by_rotation.y, by_rotation.z, normal.x, normal.y, normal.z])
}

/// A selected point from LiDAR coordinates.
pub(crate) fn select(imu_from_lidar: &Isometry3<f64>, point: &Vector3<f64>) -> Selected {
    Selected {
        point: imu_from_lidar.rotation * point + imu_from_lidar.translation.vector,
        beam: imu_from_lidar.rotation * point.normalize(),
    }
}
