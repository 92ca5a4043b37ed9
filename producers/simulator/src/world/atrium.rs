//! An atrium drawn from a number: two sides are panes that throw nothing back, the others rough walls with a gallery;
//! planters, benches and round pillars on the floor, three people.

use crate::random::Random;

use super::build::Site;
use super::fitter::Fitter;
use super::furniture;
use super::material::Material::{ClearGlass, Concrete, Metal, Plaster, Wood};
use super::outline::Rect;
use super::solid::Solid;
use super::tour::{Step, Tour};

const STREAM: u64 = 104;
const HEIGHT: f64 = 8.0;

/// The atrium of this number, 16 to 20 m in both directions.
pub(super) fn build(building: u64) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let (length, width) = (random.within(16.0, 20.0), random.within(16.0, 20.0));
    let floor = Rect { min: [0.0, 0.0], max: [length, width] };
    let (south, east) = (random.within(1.8, 2.6), random.within(1.8, 2.6));
    let mut tour = Tour::along(&[[2.0, south], [length - east, south], [length - east, width - 2.2]]);
    tour.steps.push(Step::Stand(1.0));
    tour.steps.extend([[2.4, width - 2.2], [2.2, 0.5 * width], [0.5 * length, 0.5 * width]].map(Step::To));
    tour.steps.push(Step::Turn(120.0));
    let mut fitter = Fitter::new(tour, random);
    shell(&mut fitter.site, &floor);
    for (x, y) in [(0.3, 0.3), (0.7, 0.3), (0.3, 0.7), (0.7, 0.7)] {
        let [x, y] = [x * length, y * width];
        fitter.put(vec![
            Solid::pipe([x, y, 0.0], [x, y, HEIGHT], 0.35, Plaster),
            Solid::pipe([x, y, 0.0], [x, y, 0.12], 0.45, Concrete),
        ]);
    }
    let (a, b) = (0.42 * length, 0.62 * length);
    fitter.person(&[[a, 0.36 * width], [b, 0.36 * width], [b, 0.37 * width]], 1.0, 2.0);
    fitter.person(
        &[[0.8 * length, 0.4 * width], [0.8 * length, 0.6 * width], [0.81 * length, 0.6 * width]],
        0.7,
        0.0,
    );
    green(&mut fitter, &floor);
    (fitter.site, fitter.tour)
}

fn shell(site: &mut Site, floor: &Rect) {
    let [length, width] = floor.max;
    site.block([-3.0, -3.0, -0.3], [length + 3.0, width + 3.0, 0.0], Concrete);
    site.block([-3.0, -3.0, HEIGHT], [length + 3.0, width + 3.0, HEIGHT + 0.3], Concrete);
    // Facades of glass in the south and east, with posts and rails.
    site.block([0.0, -0.06, 0.0], [length, 0.0, HEIGHT], ClearGlass);
    site.block([length, 0.0, 0.0], [length + 0.06, width, HEIGHT], ClearGlass);
    let mut at = 0.7;
    while at < length {
        site.block([at, -0.05, 0.0], [at + 0.06, 0.1, HEIGHT], Metal);
        at += 1.4;
    }
    at = 0.7;
    while at < width {
        site.block([length - 0.1, at, 0.0], [length + 0.05, at + 0.06, HEIGHT], Metal);
        at += 1.4;
    }
    for z in [0.0, 2.6, 5.2] {
        site.block([0.0, -0.05, z], [length, 0.08, z + 0.1], Metal);
        site.block([length - 0.08, 0.0, z], [length + 0.05, width, z + 0.1], Metal);
    }
    // Convectors along the glass, a hand rail before it.
    site.block([0.5, 0.12, 0.05], [length - 0.5, 0.3, 0.62], Metal);
    site.block([length - 0.3, 0.5, 0.05], [length - 0.12, width - 0.5, 0.62], Metal);
    site.block([0.0, 0.1, 1.0], [length, 0.16, 1.1], Metal);
    site.block([length - 0.16, 0.0, 1.0], [length - 0.1, width, 1.1], Metal);
    // Walls in the north and west with doors that stand out a little, and a gallery.
    site.block([-0.3, 0.0, 0.0], [0.0, width + 0.3, HEIGHT], Plaster);
    site.block([0.0, width, 0.0], [length + 0.06, width + 0.3, HEIGHT], Plaster);
    site.block([-0.3, -0.06, 0.0], [0.0, 0.0, HEIGHT], Plaster);
    site.block([0.0, width - 1.3, 3.2], [length, width, 3.45], Concrete);
    site.block([0.0, 0.0, 3.2], [1.2, width, 3.45], Concrete);
    site.block([1.15, 0.0, 3.45], [1.2, width - 1.3, 4.45], ClearGlass);
    site.block([0.0, width - 1.3, 3.45], [length, width - 1.25, 4.45], ClearGlass);
    for share in [0.2, 0.5, 0.8] {
        site.block([share * length, width - 0.06, 0.0], [share * length + 0.95, width, 2.05], Wood);
        site.block([0.0, share * width, 0.0], [0.06, share * width + 0.95, 2.05], Wood);
    }
}

fn green(fitter: &mut Fitter, floor: &Rect) {
    for _ in 0..50 {
        let place = fitter.place(floor, 0.8);
        let [x, y] = place;
        match fitter.random.below(3) {
            0 => {
                let height = fitter.random.within(1.2, 3.0);
                let parts = furniture::plant(&mut fitter.random, place, height);
                fitter.put(parts);
            }
            1 => {
                let turn = fitter.random.within(-45.0, 45.0);
                fitter.put(vec![
                    Solid::turned([x, y, 0.42], [1.5, 0.45, 0.06], turn, Wood),
                    Solid::turned([x, y, 0.2], [1.1, 0.1, 0.4], turn, Metal),
                ]);
            }
            _ => {
                let radius = fitter.random.within(0.4, 0.8);
                let mut parts = vec![Solid::pipe([x, y, 0.0], [x, y, 0.5], radius, Concrete)];
                parts.extend(furniture::plant(&mut fitter.random, place, 1.7).into_iter().skip(1));
                fitter.put(parts);
            }
        }
    }
}
