//! An office floor drawn from a number: desks with screens and chairs, full shelves, plants, partitions, and two people.

use crate::random::Random;

use super::build::{Filling, Opening, Site, door};
use super::fitter::Fitter;
use super::furniture;
use super::material::Material::{Cloth, Concrete, Metal, Plaster};
use super::outline::Rect;
use super::room;
use super::solid::Solid;
use super::tour::{Step, Tour};

const STREAM: u64 = 103;
const CEILING: f64 = 2.8;

/// The office of this number, 15 to 18 m by 10 to 12 m.
pub(super) fn build(building: u64) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let (length, width) = (random.within(15.0, 18.0), random.within(10.0, 12.0));
    let floor = Rect { min: [0.0, 0.0], max: [length, width] };
    let aisle = random.within(0.35, 0.5) * length;
    let mut tour =
        Tour::along(&[[1.2, 1.3], [length - 1.3, 1.3], [length - 1.3, width - 1.3], [aisle, width - 1.3]]);
    tour.steps.push(Step::Stand(1.5));
    tour.steps.extend([[aisle, 3.6], [1.3, 3.6], [1.3, width - 1.4], [aisle, width - 1.3]].map(Step::To));
    tour.steps.push(Step::Turn(-90.0));
    let mut fitter = Fitter::new(tour, random);
    let window = |at: f64| Opening { at, width: 1.6, height: 2.3, filling: Filling::Window };
    let south = [window(4.0), window(7.0), window(10.0)];
    let north = [door(2.5), door(length - 3.0)];
    room::shell(&mut fitter.site, &floor, CEILING, [&south, &north, &[door(width / 2.0)], &[]]);
    fitter.person(&[[length - 5.0, 4.2], [length - 5.0, width - 3.6], [length - 5.1, 4.2]], 0.8, 1.0);
    pillars(&mut fitter, &floor);
    shelves(&mut fitter, &floor);
    desks(&mut fitter, &floor);
    clutter(&mut fitter, &floor);
    (fitter.site, fitter.tour)
}

fn pillars(fitter: &mut Fitter, floor: &Rect) {
    let [length, width] = floor.max;
    for share in [0.3, 0.62, 0.88] {
        let (x, y) = (share * length, 0.52 * width);
        fitter.put(vec![Solid::between([x - 0.2, y - 0.2, 0.0], [x + 0.2, y + 0.2, CEILING], Plaster)]);
    }
    for y in [0.25 * width, 0.5 * width, 0.75 * width] {
        let mut x = 1.0;
        while x < length - 1.5 {
            fitter.site.block([x, y - 0.1, CEILING - 0.08], [x + 1.2, y + 0.1, CEILING], Plaster);
            x += 2.4;
        }
    }
    fitter.site.block(
        [0.5, width * 0.4, CEILING - 0.35],
        [length - 0.5, width * 0.4 + 0.4, CEILING - 0.05],
        Metal,
    );
}

fn shelves(fitter: &mut Fitter, floor: &Rect) {
    let [length, width] = floor.max;
    for _ in 0..24 {
        let size =
            [fitter.random.within(0.8, 1.8), fitter.random.within(0.25, 0.4), fitter.random.within(1.0, 2.1)];
        let off = size[1] / 2.0 + 0.02;
        let (along, across) =
            (fitter.random.within(1.2, length - 1.2), fitter.random.within(1.2, width - 1.2));
        let (centre, degrees) = match fitter.random.below(4) {
            0 => ([along, off], 90.0),
            1 => ([along, width - off], -90.0),
            2 => ([off, across], 0.0),
            _ => ([length - off, across], 180.0),
        };
        let parts = furniture::shelf(&mut fitter.random, centre, size, degrees);
        fitter.put(parts);
    }
}

fn desks(fitter: &mut Fitter, floor: &Rect) {
    for _ in 0..80 {
        let centre = fitter.place(floor, 1.0);
        let quarter = 90.0 * fitter.random.below(4) as f64;
        let degrees = quarter + fitter.random.within(-6.0, 6.0);
        let (sin, cos) = f64::sin_cos(degrees.to_radians());
        let on = |dx: f64, dy: f64| [centre[0] + cos * dx - sin * dy, centre[1] + sin * dx + cos * dy];
        let mut parts = furniture::table(centre, [1.4, 0.7, 0.74], degrees);
        let [sx, sy] = on(fitter.random.within(-0.3, 0.3), 0.15);
        parts.push(Solid::turned([sx, sy, 1.05], [0.55, 0.03, 0.34], degrees, Metal));
        parts.push(Solid::pipe([sx, sy, 0.74], [sx, sy, 0.95], 0.02, Metal));
        let [dx, dy] = on(0.45, 0.0);
        parts.push(Solid::turned([dx, dy, 0.35], [0.4, 0.55, 0.6], degrees, Metal));
        if fitter.random.chance(0.4) {
            let [px, py] = on(0.0, 0.4);
            parts.push(Solid::turned([px, py, 0.65], [1.5, 0.04, 1.3], degrees, Cloth));
        }
        parts.extend(furniture::chair(on(-0.1, -0.65), 90.0 + degrees + fitter.random.within(-40.0, 40.0)));
        fitter.put(parts);
    }
}

fn clutter(fitter: &mut Fitter, floor: &Rect) {
    for _ in 0..60 {
        let place = fitter.place(floor, 0.5);
        let [x, y] = place;
        match fitter.random.below(3) {
            0 => {
                let height = fitter.random.within(0.9, 1.9);
                let parts = furniture::plant(&mut fitter.random, place, height);
                fitter.put(parts);
            }
            1 => {
                let degrees = fitter.random.within(0.0, 360.0);
                fitter.put(furniture::chair(place, degrees));
            }
            _ => {
                fitter.put(vec![Solid::pipe([x, y, 0.0], [x, y, 0.4], 0.14, Concrete)]);
            }
        }
    }
}
