//! A person who stays before the sensor: everything in view that is not beside them is hidden.

use evac_frames::Point;
use evac_geometry::nalgebra::Vector3;
use evac_simulator::Random;

use super::moving_frame;
use super::scans::recount;
use crate::Walk;

const LENGTH_S: f64 = 3.0;
/// Distance of the near side, metres.
const AHEAD_M: f64 = 0.5;
/// The person is a cylinder 0.5 m wide, metres.
const RADIUS_M: f64 = 0.25;
/// Feet and head in the LiDAR frame: 1.7 m tall before a sensor that is carried at 1.2 m, metres.
const FEET_M: f64 = -1.2;
const HEAD_M: f64 = 0.5;
/// Sways sideways by so much, so often: now and then a strip of the surroundings shows, metres and rad/s.
const SWAY_M: f64 = 0.12;
const SWAY_RAD_S: f64 = 2.0;
/// Range noise, metres.
const NOISE_M: f64 = 0.02;

pub(super) fn before_the_sensor(walk: &Walk, random: &mut Random) -> Walk {
    let mut walk = walk.clone();
    let first = moving_frame(&walk);
    let from_s = walk.seconds(first);
    for index in first..walk.frames.len() {
        let since_s = walk.seconds(index) - from_s;
        if since_s >= LENGTH_S {
            break;
        }
        let Some(frame) = walk.frames.get_mut(index) else { break };
        let centre = Vector3::new(AHEAD_M + RADIUS_M, SWAY_M * (SWAY_RAD_S * since_s).sin(), 0.0);
        frame.points = frame.points.iter().map(|point| hidden(point, &centre, random.normal())).collect();
        recount(frame);
    }
    walk
}

/// The point that the shot gives instead, if the person is in its way.
fn hidden(point: &Point, centre: &Vector3<f64>, noise: f64) -> Point {
    let place = Vector3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z));
    let Some(range) = cylinder(&place, centre) else { return *point };
    let [x, y, z] = <[f64; 3]>::from(place.normalize() * (range + NOISE_M * noise));
    point.moved_to(x as f32, y as f32, z as f32)
}

/// Distance along the ray through `place` at which it meets the cylinder, if before `place`.
fn cylinder(place: &Vector3<f64>, centre: &Vector3<f64>) -> Option<f64> {
    let range = place.norm();
    if range.is_nan() || range <= 0.0 {
        return None;
    }
    let beam = place / range;
    let (a, b) = (beam.xy().norm_squared(), beam.xy().dot(&centre.xy()));
    let square = b * b - a * (centre.xy().norm_squared() - RADIUS_M * RADIUS_M);
    let at = (square >= 0.0).then(|| (b - square.sqrt()) / a)?;
    ((0.0..range).contains(&at) && (FEET_M..HEAD_M).contains(&(at * beam.z))).then_some(at)
}
