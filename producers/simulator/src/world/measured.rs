//! A world out of point clouds that were measured: every point becomes a small disc that lies as its neighbours do.

use std::path::PathBuf;

use evac_formats::pcd::Reader;
use evac_geometry::nalgebra::{Matrix3, Vector3};
use evac_stage::StageError;

use super::build::Site;
use super::material::Material;
use super::neighbours::Neighbours;
use super::solid::Solid;
use super::tour::{Step, Tour};
use crate::trajectory::IMU_HEIGHT;

/// Points that a disc's direction is taken from.
const NEIGHBOURS: usize = 10;
/// A disc reaches this share of the way to its sixth neighbour, so that discs of an even surface close it.
const SHARE_OF_SIXTH: f64 = 0.9;
/// Radii of discs, metres: at least what a corner's points need to be seen, at most what a flat floor may be closed by.
const RADIUS: [f64; 2] = [0.05, 0.3];
/// Where neighbours are off their plane by more than this share of their spread, they are an edge or clutter, and a disc
/// through them would close what is open.
const THICK: f64 = 0.35;
/// Nothing measured this near to the way is kept, metres: the walker passes there, so it has moved since.
const CLEAR_OF_WAY: f64 = 0.7;

/// The discs of all clouds and the walk along the way points (places of the IMU in the clouds' frame, z up, metres).
pub(super) fn build(clouds: &[PathBuf], way: &[[f64; 3]]) -> Result<(Site, Tour), StageError> {
    let mut points = Vec::new();
    for path in clouds {
        let failed = |cause: evac_formats::FormatError| StageError::File(cause.to_string());
        for point in Reader::open(path).map_err(failed)? {
            let point = point.map_err(failed)?;
            if point.is_finite() {
                points.push(Vector3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z)));
            }
        }
    }
    points.retain(|point| clear_of(way, point));
    let solids = discs(&points);
    Ok((Site { solids, ..Site::default() }, tour(way)))
}

/// One disc for each point, in the points' order.
pub(super) fn discs(points: &[Vector3<f64>]) -> Vec<Solid> {
    let neighbours = Neighbours::new(points);
    let mut near = Vec::new();
    points.iter().map(|point| disc(point, &neighbours, &mut near)).collect()
}

fn disc(point: &Vector3<f64>, neighbours: &Neighbours, near: &mut Vec<(f64, Vector3<f64>)>) -> Solid {
    neighbours.nearest(point, NEIGHBOURS, near);
    let [low, high] = RADIUS;
    let reach = |index: usize| near.get(index).or(near.last()).map_or(low, |(square, _)| square.sqrt());
    // The point itself is the nearest.
    if near.len() < 4 {
        return Solid::ball((*point).into(), low, Material::Measured);
    }
    let count = near.len() as f64;
    let mean = near.iter().map(|(_, p)| *p).sum::<Vector3<f64>>() / count;
    let spread = near.iter().map(|(_, p)| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / count;
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let [thickness, breadth] = [order[0], order[1]].map(|index| eigen.eigenvalues[index].max(0.0).sqrt());
    let normal: Vector3<f64> = eigen.eigenvectors.column(order[0]).into();
    let radius = if thickness > THICK * breadth { reach(2) } else { SHARE_OF_SIXTH * reach(6) };
    Solid::disc(*point, normal, radius.clamp(low, high), Material::Measured)
}

fn clear_of(way: &[[f64; 3]], point: &Vector3<f64>) -> bool {
    way.windows(2).all(|pair| {
        let (a, b) = (Vector3::from(pair[0]), Vector3::from(pair[1]));
        let share = ((point - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
        (point - a - (b - a) * share).norm() > CLEAR_OF_WAY
    })
}

fn tour(way: &[[f64; 3]]) -> Tour {
    let floor = |place: &[f64; 3]| place[2] - IMU_HEIGHT;
    let leg = |pair: &[[f64; 3]]| {
        let [[ax, ay, _], [bx, by, _]] = [pair[0], pair[1]];
        Step::Climb([bx, by], [0.0, (bx - ax).hypot(by - ay)], floor(&pair[1]) - floor(&pair[0]))
    };
    let start = way.first().copied().unwrap_or_default();
    Tour { start: [start[0], start[1]], floor: floor(&start), steps: way.windows(2).map(leg).collect() }
}
