//! Two storeys of 3.4 m joined by a dog-leg stair, with a corridor on each.
//!
//! The stair has two flights of ten risers (0.17 m) beside each other, from x = 1.2 to a landing at half height.

use super::build::{Along, Filling, Opening, Site, WALL, door, open_door};
use super::material::Material::{Concrete, Metal, Plaster, Sign, Wood};
use crate::trajectory::Route;

const STOREY: f64 = 3.4;
const RISE: f64 = 0.17;
const RUN: f64 = 0.28;
const STEPS: u32 = 10;
/// Where both flights begin and end on the corridors' side.
const FOOT_X: f64 = 1.2;
/// Where the landing begins: the last riser of a flight is the landing's edge.
const LANDING_X: f64 = FOOT_X + RUN * 9.0;
const END_X: f64 = 5.6;
const WEST_X: f64 = -11.0;
const HALF_WIDTH: f64 = 1.4;
/// Underside of the ceilings above each floor.
const CLEAR: f64 = 3.1;

/// Along the lower corridor, up both flights, along the upper corridor and half the way back.
pub(super) fn route(start: impl Fn([f64; 3], f64) -> Route) -> Route {
    let half_storey = STOREY / 2.0;
    // The slope sets in half a step before the first riser.
    let (from, to) = (FOOT_X - 0.14, LANDING_X + 0.14);
    start([-9.0, 0.1, 0.0], 0.0)
        .stand(3.0)
        .walk_to(0.0, -0.7)
        .climb_to(4.7, -0.7, [from, to], half_storey)
        .walk_to(4.7, 0.7)
        .climb_to(0.0, 0.7, [4.7 - to, 4.7 - from], half_storey)
        .stand(1.0)
        .walk_to(-9.0, 0.0)
        .turn(180.0)
        .walk_to(-4.0, 0.0)
        .stand(1.0)
}

pub(super) fn build() -> Site {
    let mut site = Site::default();
    shell(&mut site);
    corridors(&mut site);
    stair(&mut site);
    fixtures(&mut site);
    site
}

/// Floors, ceiling and the far walls.
fn shell(site: &mut Site) {
    let (low, high) = ([WEST_X - 4.0, -7.0], [END_X + 4.0, 7.0]);
    site.block([low[0], low[1], -0.3], [high[0], high[1], 0.0], Concrete);
    site.block([low[0], low[1], STOREY + CLEAR], [high[0], high[1], STOREY + CLEAR + 0.3], Concrete);
    // The slab between the storeys ends where the stair begins; beside the stair it goes on.
    site.block([low[0], low[1], CLEAR], [FOOT_X, high[1], STOREY], Concrete);
    site.block([FOOT_X, low[1], CLEAR], [high[0], -HALF_WIDTH, STOREY], Concrete);
    site.block([FOOT_X, HALF_WIDTH, CLEAR], [high[0], high[1], STOREY], Concrete);
    let top = STOREY + CLEAR;
    site.block([low[0], low[1], 0.0], [high[0], low[1] + 0.2, top], Plaster);
    site.block([low[0], high[1] - 0.2, 0.0], [high[0], high[1], top], Plaster);
    site.block([low[0], low[1], 0.0], [low[0] + 0.2, high[1], top], Plaster);
    site.block([high[0] - 0.2, low[1], 0.0], [high[0], high[1], top], Plaster);
}

fn corridors(site: &mut Site) {
    let window = |at: f64| Opening { at, width: 1.4, height: 2.3, filling: Filling::Window };
    let floors = [
        (0.0, [door(-8.0), open_door(-4.6, -70.0), door(-1.4)], [door(-6.4), door(-2.6)]),
        (STOREY, [door(-7.2), door(-4.0), door(-0.6)], [open_door(-5.8, 75.0), door(-2.0)]),
    ];
    for (floor, south, north) in floors {
        let height = [floor, floor + CLEAR];
        site.wall(Along::X, [WEST_X, END_X], [-HALF_WIDTH - WALL, -HALF_WIDTH], height, &south);
        site.wall(Along::X, [WEST_X, END_X], [HALF_WIDTH, HALF_WIDTH + WALL], height, &north);
        let cross = [-HALF_WIDTH - WALL, HALF_WIDTH + WALL];
        site.wall(Along::Y, cross, [WEST_X - WALL, WEST_X], height, &[door(0.2)]);
    }
    // The stair's end wall over both storeys, with a window above the landing.
    let cross = [-HALF_WIDTH - WALL, HALF_WIDTH + WALL];
    site.wall(Along::Y, cross, [END_X, END_X + WALL], [0.0, STOREY / 2.0], &[]);
    let above = [STOREY / 2.0, STOREY + CLEAR];
    site.wall(Along::Y, cross, [END_X, END_X + WALL], above, &[window(0.0)]);
    // Slab edges inside the stair's side walls.
    for y in [-HALF_WIDTH - WALL, HALF_WIDTH] {
        site.block([FOOT_X, y, CLEAR], [END_X, y + WALL, STOREY], Plaster);
    }
}

fn stair(site: &mut Site) {
    let half = STOREY / 2.0;
    let width = HALF_WIDTH - 0.1;
    site.flight([FOOT_X, -HALF_WIDTH, 0.0], width, STEPS - 1, [RUN, RISE], 0.45);
    site.flight([LANDING_X, 0.1, half], width, STEPS - 1, [-RUN, RISE], 0.45);
    site.block([LANDING_X, -HALF_WIDTH, half - 0.25], [END_X, HALF_WIDTH, half], Concrete);
    // Balustrades between the flights, a piece a step.
    for step in 0..STEPS - 1 {
        let x = FOOT_X + RUN * f64::from(step);
        let up = RISE * f64::from(step + 1);
        site.block([x, -0.1, up], [x + RUN, -0.05, up + 0.9], Metal);
        let down = STOREY - up;
        site.block([x, 0.05, down], [x + RUN, 0.1, down + 0.9], Metal);
    }
    // The upper floor's edge above the first flight.
    site.block([FOOT_X - 0.05, -HALF_WIDTH, STOREY], [FOOT_X, -0.05, STOREY + 1.0], Metal);
}

fn fixtures(site: &mut Site) {
    for floor in [0.0, STOREY] {
        let ceiling = floor + CLEAR;
        for x in [-10.0, -7.0, -4.0, -1.0] {
            site.block([x, -0.1, ceiling - 0.07], [x + 1.2, 0.1, ceiling], Plaster);
        }
        site.block([WEST_X, 0.9, ceiling - 0.5], [0.6, 1.3, ceiling - 0.15], Metal);
        for x in [-9.4, -5.2, -3.3, 0.2] {
            site.block([x, 0.85, ceiling - 0.55], [x + 0.06, HALF_WIDTH, ceiling], Metal);
        }
    }
    // Lower corridor.
    site.block([-7.1, -HALF_WIDTH, 0.0], [-5.9, -HALF_WIDTH + 0.4, 1.8], Metal);
    site.block([-3.6, -HALF_WIDTH, 0.8], [-3.0, -HALF_WIDTH + 0.2, 1.6], Sign);
    site.block([-4.6, HALF_WIDTH - 0.12, 0.1], [-3.4, HALF_WIDTH, 0.8], Metal);
    site.block([-0.5, HALF_WIDTH - 0.3, 0.0], [0.3, HALF_WIDTH, 1.1], Wood);
    site.turned([-10.2, 1.0, 0.3], [0.6, 0.4, 0.6], 20.0, Wood);
    site.turned([-2.0, -5.0, 0.5], [1.6, 0.8, 1.0], 35.0, Wood);
    // Landing: a radiator below the window, and the storey's sign.
    site.block([END_X - 0.12, -0.6, STOREY / 2.0 + 0.15], [END_X, 0.6, STOREY / 2.0 + 0.7], Metal);
    site.block([END_X - 0.03, 0.85, 3.2], [END_X, 1.25, 3.6], Sign);
    // Upper corridor.
    site.block([-9.6, -HALF_WIDTH, STOREY], [-8.2, -HALF_WIDTH + 0.35, STOREY + 1.2], Wood);
    site.block([-2.9, -HALF_WIDTH, STOREY], [-2.1, -HALF_WIDTH + 0.4, STOREY + 2.0], Metal);
    site.block([-7.6, HALF_WIDTH - 0.15, STOREY + 0.5], [-7.4, HALF_WIDTH, STOREY + 1.05], Sign);
    site.block([-0.9, HALF_WIDTH - 0.2, STOREY + 0.8], [-0.3, HALF_WIDTH, STOREY + 1.6], Sign);
    site.turned([-10.4, -0.9, STOREY + 0.4], [0.5, 0.5, 0.8], 30.0, Wood);
}
