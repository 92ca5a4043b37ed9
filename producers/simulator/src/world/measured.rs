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

#[cfg(test)]
mod tests {
    use super::super::bvh::Bvh;
    use super::super::ray::Ray;
    use super::*;
    use crate::random::Random;

    #[test]
    fn discs_of_a_measured_plane_close_it_and_lie_in_it() {
        let mut random = Random::new(8, 0);
        // A tilted wall, a point every 10 cm with 5 mm of noise, 4 m before the origin.
        let normal = Vector3::new(1.0, 0.15, -0.1).normalize();
        let (u, v) = (normal.cross(&Vector3::z()).normalize(), normal.cross(&Vector3::y()).normalize());
        let points: Vec<Vector3<f64>> = (0..3600)
            .map(|k| {
                let [a, b] = [k % 60, k / 60].map(|i| f64::from(i) * 0.1 - 3.0);
                normal * (4.0 + 0.005 * random.normal()) + u * a + v * b
            })
            .collect();
        let world = Bvh::new(discs(&points));
        let (mut squares, mut largest) = (0.0, 0.0_f64);
        for shot in 0..2000 {
            let beam = crate::mid40::direction(shot * 97);
            let (range, _) = world.cast(&Ray::new(Vector3::zeros(), beam), 90.0).unwrap();
            let off = (beam * range).dot(&normal) - 4.0;
            squares += off * off;
            largest = largest.max(off.abs());
        }
        let rms = f64::sqrt(squares / 2000.0);
        assert!(rms < 0.01 && largest < 0.04, "rms {rms} m, largest {largest} m");
    }

    #[test]
    fn what_was_measured_on_the_way_is_left_out_and_the_way_is_walked_at_its_heights() {
        let way = [[0.0, 0.0, 1.5], [10.0, 0.0, 1.0]];
        assert!(!clear_of(&way, &Vector3::new(5.0, 0.3, 1.25)));
        assert!(clear_of(&way, &Vector3::new(5.0, 0.0, 0.2)));
        assert!(clear_of(&way, &Vector3::new(11.0, 0.0, 1.0)));
        let tour = tour(&way);
        assert!((tour.floor - 0.3).abs() < 1e-9);
        assert_eq!(tour.places(), vec![[0.0, 0.0], [10.0, 0.0]]);
    }

    #[test]
    fn a_cloud_that_is_not_there_is_named() {
        let error = build(&[PathBuf::from("no/such/cloud.pcd")], &[[0.0; 3], [5.0, 0.0, 0.0]]).unwrap_err();
        assert!(matches!(&error, StageError::File(text) if text.contains("no/such/cloud.pcd")), "{error}");
    }
}
