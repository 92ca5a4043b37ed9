//! Which plane a point lies on (design section 5.5).

use evac_geometry::nalgebra::{Isometry3, SMatrix, SVector, Vector3};

use super::plane_map::{EDGES, PlaneMap};
use super::state::{Covariance, State};

/// Gate on the residual in standard deviations, squared.
const GATE_SQUARED: f64 = 9.0;
/// No extrapolation of a plane beyond the spread of its points.
const MAX_LEVERAGE: f64 = 12.0;
/// Noise of a point that no geometry takes away (beam direction, time), metres.
const POINT_FLOOR: f64 = 0.005;

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
    /// Index of the plane's cell: matches of one cell share that plane's error.
    pub(crate) cell: usize,
    /// In the IMU frame.
    pub(crate) point: Vector3<f64>,
    /// Unit normal, map frame.
    pub(crate) normal: Vector3<f64>,
    /// `normal . centroid`.
    pub(crate) offset: f64,
    /// Variance of the point along the normal.
    pub(crate) point_variance: f64,
    /// Variance of the plane at the point.
    pub(crate) plane_variance: f64,
}

/// Finds for every selected point the first plane, coarse to fine, whose residual passes the gate; returns how many
/// points had any plane to be compared with.
///
/// `predicted` widens the gate by the predicted pose's covariance and is given in the first iteration only; `gate_floor` (metres) widens it
/// in the loose mode.
pub(crate) fn associate(
    map: &PlaneMap,
    selected: &[Selected],
    state: &State,
    predicted: Option<&Covariance>,
    range_noise: f64,
    gate_floor: f64,
    matches: &mut Vec<Match>,
) -> usize {
    matches.clear();
    let rotation = state.rotation.to_rotation_matrix();
    let predicted: Option<SMatrix<f64, 6, 6>> = predicted.map(|p| p.fixed_view::<6, 6>(0, 0).into_owned());
    let mut in_view = 0;
    for candidate in selected {
        let point = rotation * candidate.point + state.position;
        let beam = rotation * candidate.beam;
        let mut seen = false;
        for level in 0..EDGES.len() {
            let Some((index, cell)) = map.find(level, &point) else { continue };
            let Some(plane) = cell.plane() else { continue };
            let leverage = plane.leverage(&point);
            if leverage > MAX_LEVERAGE {
                continue;
            }
            seen = true;
            let residual = plane.distance(&point);
            let incidence = beam.dot(&plane.normal);
            let point_variance = (range_noise * incidence).powi(2) + POINT_FLOOR.powi(2);
            let plane_variance = plane.variances[0] / plane.points * leverage;
            let mut variance = point_variance + plane_variance + gate_floor * gate_floor;
            if let Some(predicted) = &predicted {
                let h = pose_row(
                    &rotation.inverse_transform_vector(&plane.normal),
                    &plane.normal,
                    &candidate.point,
                );
                variance += h.dot(&(predicted * h));
            }
            if residual * residual < GATE_SQUARED * variance {
                matches.push(Match {
                    cell: index,
                    point: candidate.point,
                    normal: plane.normal,
                    offset: plane.normal.dot(&plane.centroid),
                    point_variance,
                    plane_variance,
                });
                break;
            }
        }
        in_view += usize::from(seen);
    }
    // One cell's matches side by side; stable order within a cell keeps sums reproducible.
    matches.sort_unstable_by(|a, b| {
        a.cell
            .cmp(&b.cell)
            .then_with(|| a.point.x.total_cmp(&b.point.x))
            .then_with(|| a.point.y.total_cmp(&b.point.y))
    });
    in_view
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
