//! The Mid-40: rosette, ranges and their faults.

use std::f64::consts::TAU;

use evac_formats::livox_sdk1::DATAGRAM_SHOTS;
use evac_frames::Point;
use evac_geometry::nalgebra::{Isometry3, Matrix3, Vector3};

use crate::config::Config;
use crate::random::Random;
use crate::world::{Cylinder, Ray, World};

/// Shots per second.
const SHOTS_PER_SECOND: u64 = 100_000;
/// Time between two shots, nanoseconds.
pub const SHOT_NS: i64 = 10_000;
/// Shots in one 100 ms frame.
pub(crate) const SHOTS_PER_FRAME: usize = 10_000;
/// Diameter of the circular field of view, degrees.
pub const FIELD_OF_VIEW_DEG: f64 = 38.4;

/// Turns of the two prisms per minute; they turn against each other.
const PRISM_RPM: [i64; 2] = [7294, -4664];

/// Direction of shot number `shot` since power-on, unit vector in the LiDAR frame (x forward, y left, z up).
///
/// Two thin prisms of equal power, each deflecting by a quarter of the field of view: the deflections add as vectors in
/// the plane across the axis (first-order prism optics), which gives the rosette through the centre.
pub fn direction(shot: u64) -> Vector3<f64> {
    const SHOTS_PER_MINUTE: i64 = 60 * SHOTS_PER_SECOND as i64;
    let [first, second] = PRISM_RPM.map(|rpm| {
        // In whole numbers, so that the phase stays exact for ever.
        let turned = (shot as i64 % SHOTS_PER_MINUTE * rpm).rem_euclid(SHOTS_PER_MINUTE);
        (TAU * turned as f64 / SHOTS_PER_MINUTE as f64).sin_cos()
    });
    let deflection = (FIELD_OF_VIEW_DEG / 4.0).to_radians();
    let (y, z) = (deflection * (first.1 + second.1), deflection * (first.0 + second.0));
    let off_axis = y.hypot(z);
    let scale = if off_axis > 1e-12 { off_axis.sin() / off_axis } else { 1.0 };
    Vector3::new(off_axis.cos(), y * scale, z * scale)
}

/// The sensor with its noise.
#[derive(Debug, Clone)]
pub(crate) struct Mid40 {
    random: Random,
    range_noise_m: f64,
    drop_out_share: f64,
    stray_share: f64,
    min_range_m: f64,
    max_range_m: f64,
    people: Vec<Cylinder>,
}

impl Mid40 {
    pub(crate) fn new(config: &Config, random: Random) -> Self {
        Self {
            random,
            range_noise_m: config.range_noise_m,
            drop_out_share: config.drop_out_share,
            stray_share: config.stray_share,
            min_range_m: config.min_range_m,
            max_range_m: config.max_range_m,
            people: Vec::new(),
        }
    }

    /// Measures frame number `frame` (100 ms) into `points` (cleared first), each shot from the sensor's pose at its
    /// own time. `world_from_lidar` gives the pose at a time in seconds.
    pub(crate) fn scan(
        &mut self,
        frame: u64,
        world: &World,
        world_from_lidar: impl Fn(f64) -> Isometry3<f64>,
        points: &mut Vec<Point>,
    ) {
        points.clear();
        let first_shot = frame * SHOTS_PER_FRAME as u64;
        let time =
            |packet: usize| (first_shot + (packet * DATAGRAM_SHOTS) as u64) as f64 / SHOTS_PER_SECOND as f64;
        let mut start = Placement::of(&world_from_lidar(time(0)));
        for packet in 0..SHOTS_PER_FRAME / DATAGRAM_SHOTS {
            // Linear between the poses of each millisecond: off by less than a micrometre and a microradian here.
            let end = Placement::of(&world_from_lidar(time(packet + 1)));
            world.people_at(time(packet), &mut self.people);
            for index in 0..DATAGRAM_SHOTS {
                let in_frame = packet * DATAGRAM_SHOTS + index;
                let placement = start.towards(&end, index as f64 / DATAGRAM_SHOTS as f64);
                let beam = direction(first_shot + in_frame as u64);
                points.push(self.shoot(world, &placement, &beam, in_frame as i64 * SHOT_NS));
            }
            start = end;
        }
    }

    /// Draws what a frame would have drawn, so that the next one's noise is as if it had been measured.
    pub(crate) fn pass_over(&mut self) {
        for _ in 0..SHOTS_PER_FRAME {
            self.draw();
        }
    }

    fn draw(&mut self) -> (f64, f64, f64) {
        (self.random.uniform(), self.random.uniform(), self.random.normal())
    }

    fn shoot(&mut self, world: &World, placement: &Placement, beam: &Vector3<f64>, offset_ns: i64) -> Point {
        let no_return = Point::new(0.0, 0.0, 0.0, offset_ns, 0);
        let ray = Ray::new(placement.origin, placement.rotation * beam);
        let hit = world.cast(&ray, &self.people, self.max_range_m);
        // The same draws for every shot, so that one shot's fate does not move the next one's noise.
        let (luck, stray, noise) = self.draw();
        let Some((range, material)) = hit else {
            return no_return;
        };
        let range = if stray < self.stray_share {
            // Anywhere from the housing to half as far again as the surface.
            stray / self.stray_share * 1.5 * range
        } else {
            range + noise * self.range_noise_m
        };
        let returned = luck >= self.drop_out_share + (1.0 - material.returns()) * (1.0 - self.drop_out_share);
        if !returned || range < self.min_range_m || range > self.max_range_m {
            return no_return;
        }
        let [x, y, z] = <[f64; 3]>::from(beam * range).map(on_the_wire);
        let reflectivity = (material.reflectivity() + 3.0 * noise).clamp(0.0, 255.0) as u8;
        Point::new(x, y, z, offset_ns, reflectivity)
    }
}

/// Metres after the way over the wire as whole millimetres.
fn on_the_wire(metres: f64) -> f32 {
    ((metres * 1e3).round() * 1e-3) as f32
}

/// A pose as a matrix, because a few million rays are turned by it.
#[derive(Debug, Clone, Copy)]
struct Placement {
    origin: Vector3<f64>,
    rotation: Matrix3<f64>,
}

impl Placement {
    fn of(pose: &Isometry3<f64>) -> Self {
        Self { origin: pose.translation.vector, rotation: *pose.rotation.to_rotation_matrix().matrix() }
    }

    fn towards(&self, end: &Self, share: f64) -> Self {
        Self {
            origin: self.origin + (end.origin - self.origin) * share,
            rotation: self.rotation + (end.rotation - self.rotation) * share,
        }
    }
}
