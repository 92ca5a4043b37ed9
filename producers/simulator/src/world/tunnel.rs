//! A tunnel drawn from a number: round bores through rock in a bent line, domed chambers at some of the bends, side
//! niches, pipes along the walls, rails on the floor.

use evac_geometry::nalgebra::Vector3;

use crate::random::Random;

use super::build::Site;
use super::fitter::Fitter;
use super::material::Material::{Concrete, Metal, Plaster, Stone, Wood};
use super::shape::Shape;
use super::solid::Solid;
use super::tour::{Step, Tour};

const STREAM: u64 = 101;
/// Height of the bores' axes above the floor, metres.
const AXIS: f64 = 0.95;

/// The tunnel of this number: three legs there, a turn about, and back to the last bend but one.
pub(super) fn build(building: u64) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let radius = random.within(1.45, 1.85);
    let mut nodes = vec![[0.0, 0.0]];
    let (mut heading, mut at) = (random.within(-0.2, 0.2), [0.0, 0.0]);
    let side = if random.chance(0.5) { 1.0 } else { -1.0 };
    for _ in 0..3 {
        let length = random.within(8.0, 12.0);
        let (sin, cos) = f64::sin_cos(heading);
        at = [at[0] + length * cos, at[1] + length * sin];
        nodes.push(at);
        heading += side * random.within(40.0, 95.0_f64).to_radians();
    }
    let mut tour = Tour::along(&nodes);
    tour.steps.push(Step::Stand(1.5));
    tour.steps.push(Step::To(nodes[2]));
    tour.steps.push(Step::To([0, 1].map(|i| nodes[2][i] + 0.6 * (nodes[1][i] - nodes[2][i]))));
    let mut fitter = Fitter::new(tour, random);
    fitter.site.block([-40.0, -40.0, -0.6], [60.0, 40.0, 0.0], Concrete);
    for (leg, pair) in nodes.windows(2).enumerate() {
        bore(&mut fitter, [pair[0], pair[1]], radius, leg);
    }
    for node in &nodes[1..3] {
        if fitter.random.chance(0.6) {
            chamber(&mut fitter, *node, 1.45 * radius);
        }
    }
    (fitter.site, fitter.tour)
}

fn bore(fitter: &mut Fitter, [from, to]: [[f64; 2]; 2], radius: f64, leg: usize) {
    let (a, b) = (Vector3::new(from[0], from[1], AXIS), Vector3::new(to[0], to[1], AXIS));
    let (length, way) = ((b - a).norm(), (b - a).normalize());
    let across = Vector3::new(-way.y, way.x, 0.0);
    // The bore ends a little behind the bend, before a flat face.
    let beyond = 0.75 * radius;
    fitter.site.hollows.push(Shape::Pipe {
        centre: (a + b) / 2.0,
        axis: way,
        half_length: length / 2.0 + beyond,
        radius,
    });
    let on =
        |s: f64, left: f64, z: f64| <[f64; 3]>::from(a + way * s + across * left + Vector3::z() * (z - AXIS));
    // Pipes on both sides, high and low, between the bends.
    let (start, end) = (radius + 0.3, length - radius - 0.3);
    for _ in 0..3 {
        let side = if fitter.random.chance(0.5) { 1.0 } else { -1.0 };
        let lift = fitter.random.within(-0.2, 0.9);
        let thick = fitter.random.within(0.04, 0.13);
        let out = (radius - thick - 0.12) * f64::cos(lift);
        let z = AXIS + (radius - thick - 0.12) * f64::sin(lift);
        let run = Solid::pipe(on(start, side * out, z), on(end, side * out, z), thick, Metal);
        // Oblique pipes have large bounds: their way is known to be free, so is their place on the wall.
        fitter.site.solids.push(run);
        let mut at = start + 0.4;
        while at < end {
            let foot = on(at, side * (out + 0.2), z - thick - 0.05);
            fitter.site.solids.push(Solid::pipe(on(at, side * (out - thick), z), foot, 0.025, Metal));
            at += 1.9;
        }
    }
    // Rails on sleepers.
    for left in [-0.35, 0.35] {
        let (low, high) = (on(0.5, left, 0.05), on(length - 0.5, left, 0.05));
        fitter.site.solids.push(Solid::pipe(low, high, 0.035, Metal));
    }
    let yaw = way.y.atan2(way.x).to_degrees();
    let mut at = 0.7;
    while at < length - 0.7 {
        fitter.site.turned(on(at, 0.0, 0.02), [0.18, 1.1, 0.05], yaw, Wood);
        at += 0.75;
    }
    niches(fitter, leg, length, radius, way, &on);
    // Lamps and rubble.
    let mut at = 2.0;
    while at < length - 1.0 {
        fitter.site.turned(on(at, 0.0, AXIS + radius - 0.15), [0.9, 0.14, 0.09], yaw, Plaster);
        at += 3.1;
    }
    for _ in 0..14 {
        let size = fitter.random.within(0.08, 0.28);
        let side = if fitter.random.chance(0.5) { 1.0 } else { -1.0 };
        let [x, y, z] = on(fitter.random.within(0.5, length - 0.5), side * (radius - 0.35), size * 0.35);
        let turn = [0; 3].map(|_| fitter.random.within(-60.0, 60.0));
        fitter.put(vec![Solid::tilted([x, y, z], [size, size * 0.8, size * 0.7], turn, Stone)]);
    }
}

/// Short side bores.
fn niches(
    fitter: &mut Fitter,
    leg: usize,
    length: f64,
    radius: f64,
    way: Vector3<f64>,
    on: &impl Fn(f64, f64, f64) -> [f64; 3],
) {
    let count = 1 + leg % 2;
    for _ in 0..count {
        let side = if fitter.random.chance(0.5) { 1.0 } else { -1.0 };
        let at = fitter.random.within(2.5, length - 2.5);
        let centre = Vector3::from(on(at, side * radius, AXIS));
        let axis = Vector3::new(-way.y, way.x, 0.0);
        let half_length = fitter.random.within(0.8, 1.8);
        fitter.site.hollows.push(Shape::Pipe {
            centre,
            axis,
            half_length,
            radius: fitter.random.within(0.6, 0.9),
        });
    }
}

/// A round chamber with a domed roof about a bend, and a tank at its wall where there is room.
fn chamber(fitter: &mut Fitter, [x, y]: [f64; 2], radius: f64) {
    let top = AXIS + 1.2;
    fitter.site.hollows.push(Shape::Pipe {
        centre: Vector3::new(x, y, top / 2.0 - 0.25),
        axis: Vector3::z(),
        half_length: top / 2.0 + 0.25,
        radius,
    });
    fitter.site.hollows.push(Shape::Ball { centre: Vector3::new(x, y, top - 0.6), radius: radius * 0.98 });
    for _ in 0..8 {
        let (sin, cos) = fitter.random.within(0.0, std::f64::consts::TAU).sin_cos();
        let reach = radius - 0.4;
        fitter.put(super::furniture::tank([x + cos * reach, y + sin * reach], 0.3, 1.3));
    }
}
