//! A plant room drawn from a number: tanks, pipes in all directions, machines, a walk round the middle.

use crate::random::Random;

use super::build::{Site, door, open_door};
use super::fitter::Fitter;
use super::furniture;
use super::material::Material::{Concrete, Metal, Sign};
use super::outline::Rect;
use super::room;
use super::solid::Solid;
use super::tour::{Step, Tour};

const STREAM: u64 = 102;

/// The plant of this number, 15 to 19 m by 11 to 14 m.
pub(super) fn build(building: u64) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let (length, width, height) =
        (random.within(15.0, 19.0), random.within(11.0, 14.0), random.within(3.6, 5.5));
    let hall = Rect { min: [0.0, 0.0], max: [length, width] };
    let (near, far) = (random.within(1.4, 2.0), random.within(1.4, 2.0));
    let middle = random.within(0.4, 0.6) * length;
    let mut tour =
        Tour::along(&[[1.6, near], [length - 1.5, near], [length - 1.5, width - far], [middle, width - far]]);
    tour.steps.push(Step::Stand(1.0));
    tour.steps.extend([[middle, near], [1.4, near], [1.4, width - 1.6]].map(Step::To));
    tour.steps.push(Step::Turn(180.0));
    let mut fitter = Fitter::new(tour, random);
    room::shell(
        &mut fitter.site,
        &hall,
        height,
        [&[door(4.0), door(length - 4.0)], &[open_door(3.0, 70.0)], &[door(width / 2.0)], &[]],
    );
    vessels(&mut fitter, &hall);
    machines(&mut fitter, &hall);
    pipes(&mut fitter, &hall, height);
    (fitter.site, fitter.tour)
}

fn vessels(fitter: &mut Fitter, hall: &Rect) {
    for _ in 0..60 {
        let radius = fitter.random.within(0.3, 1.0);
        let place = fitter.place(hall, radius * 1.1 + 0.05);
        let height = fitter.random.within(1.2, 3.2);
        if fitter.random.chance(0.6) {
            fitter.put(furniture::tank(place, radius, height));
        } else {
            // A vessel on its side, on two saddles.
            let [x, y] = place;
            let (long, z) = (fitter.random.within(0.8, 1.6), radius * 0.7 + 0.35);
            fitter.put(vec![
                Solid::pipe([x - long, y, z], [x + long, y, z], radius * 0.7, Metal),
                Solid::ball([x - long, y, z], radius * 0.65, Metal),
                Solid::ball([x + long, y, z], radius * 0.65, Metal),
                Solid::between([x - 0.7, y - 0.2, 0.0], [x - 0.5, y + 0.2, 0.4], Concrete),
                Solid::between([x + 0.5, y - 0.2, 0.0], [x + 0.7, y + 0.2, 0.4], Concrete),
            ]);
        }
    }
}

fn machines(fitter: &mut Fitter, hall: &Rect) {
    for _ in 0..60 {
        let size = [0; 3].map(|_| fitter.random.within(0.25, 1.1));
        let [x, y] = fitter.place(hall, 0.5);
        let turn = fitter.random.within(-30.0, 30.0);
        let plinth = Solid::turned([x, y, 0.06], [size[0] + 0.1, size[1] + 0.1, 0.12], turn, Concrete);
        let body = Solid::turned([x, y, 0.12 + size[2] / 2.0], size, turn, Metal);
        let wheel = Solid::pipe([x, y, 0.12 + size[2]], [x, y, 0.3 + size[2]], 0.03, Metal);
        let knob = Solid::ball([x, y, 0.35 + size[2]], 0.09, Sign);
        fitter.put(vec![plinth, body, wheel, knob]);
    }
}

/// Pipes overhead along and across with elbows down to the floor, and along the walls.
fn pipes(fitter: &mut Fitter, hall: &Rect, height: f64) {
    let [length, width] = hall.max;
    for _ in 0..16 {
        let radius = fitter.random.within(0.04, 0.2);
        let z = fitter.random.within(2.15, height - 0.3);
        let [x, y] = fitter.place(hall, 0.3);
        let to = fitter.place(hall, 0.3);
        let (from, end) = if fitter.random.chance(0.5) { ([x, y], [to[0], y]) } else { ([x, y], [x, to[1]]) };
        if (from[0] - end[0]).hypot(from[1] - end[1]) < 1.0 {
            continue;
        }
        let [[ax, ay], [bx, by]] = [from, end];
        fitter.site.solids.push(Solid::pipe([ax, ay, z], [bx, by, z], radius, Metal));
        for [x, y] in [from, end] {
            fitter.put(vec![
                Solid::ball([x, y, z], radius * 1.15, Metal),
                Solid::pipe([x, y, 0.0], [x, y, z], radius, Metal),
                Solid::pipe([x, y, 1.0], [x, y, 1.08], radius * 1.6, Metal),
            ]);
        }
    }
    for _ in 0..12 {
        let radius = fitter.random.within(0.03, 0.12);
        let z = fitter.random.within(0.3, 3.0).min(height - 0.2);
        let off = radius + 0.06;
        let (a, b) = (fitter.random.within(0.3, 0.5), fitter.random.within(0.55, 0.97));
        let along = |share: f64, long: f64| share * long;
        let (from, to) = match fitter.random.below(4) {
            0 => ([along(a, length), off, z], [along(b, length), off, z]),
            1 => ([along(a, length), width - off, z], [along(b, length), width - off, z]),
            2 => ([off, along(a, width), z], [off, along(b, width), z]),
            _ => ([length - off, along(a, width), z], [length - off, along(b, width), z]),
        };
        fitter.put(vec![Solid::pipe(from, to, radius, Metal)]);
    }
}
