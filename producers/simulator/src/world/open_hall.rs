//! An empty hall of 50 x 30 x 8 m: far walls, few things, four people.

use crate::random::Random;

use super::build::{Filling, Opening, Site, door, passage};
use super::fitter::Fitter;
use super::material::Material::{Concrete, Metal, Plaster, Wood};
use super::outline::Rect;
use super::room;
use super::solid::Solid;
use super::tour::{Step, Tour};

const STREAM: u64 = 105;
const SIZE: [f64; 3] = [50.0, 30.0, 8.0];

/// The hall with the things of this number in it, crossed in a wide loop.
pub(super) fn build(building: u64) -> (Site, Tour) {
    let mut random = Random::new(building, STREAM);
    let [length, width, height] = SIZE;
    let floor = Rect { min: [0.0; 2], max: [length, width] };
    let (x0, x1) = (random.within(10.0, 14.0), random.within(30.0, 34.0));
    let (y0, y1) = (random.within(7.0, 9.0), random.within(19.0, 22.0));
    let mut tour = Tour::along(&[[x0, y0], [x1, y0 + 1.0], [x1 + 2.0, y1]]);
    tour.steps.push(Step::Stand(1.5));
    tour.steps.extend([[x0 + 2.0, y1 - 1.0], [x0, y0 + 4.0], [x0 + 8.0, y0 + 2.0]].map(Step::To));
    tour.steps.push(Step::Turn(180.0));
    let mut fitter = Fitter::new(tour, random);
    let gate = |at: f64| passage(at, 4.0, 4.2);
    let window = |at: f64| Opening { at, width: 3.0, height: 4.5, filling: Filling::Window };
    let south = [door(6.0), gate(20.0), door(38.0)];
    let north = [window(10.0), window(18.0), gate(28.0), window(40.0)];
    room::shell(&mut fitter.site, &floor, height, [&south, &north, &[gate(12.0)], &[door(9.0), door(21.0)]]);
    fitter.person(&[[18.0, 14.0], [30.0, 15.0], [30.0, 15.2]], 1.2, 3.0);
    fitter.person(&[[8.0, 25.5], [24.0, 26.0], [24.0, 26.2]], 1.0, 0.0);
    fitter.person(&[[38.5, 10.0], [39.0, 20.0], [39.2, 20.0]], 1.3, 5.0);
    fitter.person(&[[20.0, 3.0], [29.0, 4.0], [29.0, 4.2]], 0.9, 1.0);
    for x in [12.5, 25.0, 37.5] {
        fitter.site.block([x - 0.2, 0.0, height - 0.6], [x + 0.2, width, height], Concrete);
        for y in [0.15, width - 0.15] {
            fitter.site.block([x - 0.25, y - 0.15, 0.0], [x + 0.25, y + 0.15, height], Plaster);
        }
    }
    for _ in 0..9 {
        let [x, y] = fitter.place(&floor, 1.5);
        let size = [0; 3].map(|_| fitter.random.within(0.5, 1.6));
        let turn = fitter.random.within(-45.0, 45.0);
        let material = if fitter.random.chance(0.5) { Wood } else { Metal };
        fitter.put(vec![Solid::turned([x, y, size[2] / 2.0], size, turn, material)]);
    }
    (fitter.site, fitter.tour)
}
