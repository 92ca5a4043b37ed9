//! A basement corridor in a rectangle: centre line 17 x 11 m, 2 m wide, 2.5 m high. Each side has its own
//! installations (duct, pipes, cable tray), so that a person tells them apart in a plan and a match tells them apart too.

use super::build::{Along, Site, WALL, door, open_door, passage};
use super::material::Material::{Concrete, Glass, Metal, Plaster, Sign, Wood};
use crate::trajectory::Route;

const CEILING: f64 = 2.5;
const STOREY: [f64; 2] = [0.0, CEILING];

/// Once round, counterclockwise, with a stop at the notice board and a last stretch over the first leg again.
pub(super) fn route(start: impl Fn([f64; 3], f64) -> Route) -> Route {
    start([0.0; 3], 0.0)
        .stand(3.0)
        .walk_to(17.0, 0.0)
        .walk_to(17.0, 11.0)
        .walk_to(8.0, 11.0)
        .stand(1.5)
        .walk_to(0.0, 11.0)
        .walk_to(0.0, 0.0)
        .walk_to(3.0, 0.0)
        .stand(1.0)
}

pub(super) fn build() -> Site {
    let mut site = Site::default();
    site.block([-6.0, -7.0, -0.3], [24.0, 18.0, 0.0], Concrete);
    site.block([-6.0, -7.0, CEILING], [24.0, 18.0, CEILING + 0.3], Concrete);
    outer_walls(&mut site);
    inner_walls(&mut site);
    rooms(&mut site);
    south_installations(&mut site);
    east_installations(&mut site);
    north_installations(&mut site);
    west_installations(&mut site);
    lamps(&mut site);
    site
}

fn outer_walls(site: &mut Site) {
    let south = [door(1.6), open_door(6.2, -75.0), door(9.6), door(13.8)];
    site.wall(Along::X, [-1.0 - WALL, 18.0 + WALL], [-1.0 - WALL, -1.0], STOREY, &south);
    let east = [door(2.2), open_door(6.0, 80.0), door(9.0)];
    site.wall(Along::Y, [-1.0, 12.0], [18.0, 18.0 + WALL], STOREY, &east);
    let north = [door(14.2), passage(10.4, 2.2, 2.3), door(6.4), door(2.0)];
    site.wall(Along::X, [-1.0 - WALL, 18.0 + WALL], [12.0, 12.0 + WALL], STOREY, &north);
    let west = [door(8.4), passage(4.6, 1.6, 2.2), door(1.6)];
    site.wall(Along::Y, [-1.0, 12.0], [-1.0 - WALL, -1.0], STOREY, &west);
}

fn inner_walls(site: &mut Site) {
    let south = [door(3.4), open_door(11.4, 70.0), door(14.6)];
    site.wall(Along::X, [1.0, 16.0], [1.0, 1.0 + WALL], STOREY, &south);
    site.wall(Along::Y, [1.0, 10.0], [16.0 - WALL, 16.0], STOREY, &[door(3.6), door(7.6)]);
    site.wall(
        Along::X,
        [1.0, 16.0],
        [10.0 - WALL, 10.0],
        STOREY,
        &[door(12.4), open_door(4.2, -80.0), door(8.2)],
    );
    site.wall(Along::Y, [1.0, 10.0], [1.0, 1.0 + WALL], STOREY, &[door(6.6)]);
}

/// What is seen through the open doors and passages.
fn rooms(site: &mut Site) {
    // Store room in the south, with shelves.
    room(site, [4.2, -4.9], [8.4, -1.3]);
    site.block([4.2, -4.9, 0.0], [8.4, -4.4, 1.9], Metal);
    site.block([7.9, -4.2, 0.0], [8.4, -2.2, 2.0], Metal);
    site.turned([5.4, -3.4, 0.4], [0.8, 0.6, 0.8], 25.0, Wood);
    // Plant room in the east, with two tanks and a pump.
    room(site, [18.3, 4.2], [22.4, 8.6]);
    site.block([20.6, 4.5, 0.0], [22.0, 6.0, 2.1], Metal);
    site.block([20.9, 6.7, 0.0], [22.2, 8.2, 1.7], Metal);
    site.turned([19.2, 7.8, 0.3], [0.9, 0.5, 0.6], 40.0, Metal);
    // Niche with vending machines in the north.
    room(site, [9.3, 12.3], [11.5, 13.6]);
    site.block([9.3, 12.8, 0.0], [10.3, 13.6, 1.85], Metal);
    site.block([10.4, 12.8, 0.0], [11.3, 13.6, 1.8], Sign);
    // Blind passage in the west, ending at a glass door.
    room(site, [-5.2, 3.8], [-1.3, 5.4]);
    site.block([-3.6, 3.8, 0.0], [-3.55, 5.4, 2.3], Glass);
    // Two rooms inside the block.
    room(site, [9.4, 1.3], [13.4, 4.8]);
    site.block([12.3, 2.2, 0.0], [13.2, 4.0, 0.75], Wood);
    site.block([9.5, 4.3, 0.0], [11.2, 4.8, 1.6], Wood);
    room(site, [2.6, 6.2], [6.2, 9.7]);
    site.block([3.0, 6.3, 0.0], [5.8, 6.8, 1.9], Metal);
    site.turned([5.4, 8.6, 0.5], [0.6, 0.6, 1.0], 15.0, Wood);
}

/// Four thin walls around a rectangle; where it borders on the corridor the corridor's own wall with its opening counts.
fn room(site: &mut Site, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) {
    const SKIN: f64 = 0.1;
    let at_corridor = |value: f64, faces: [f64; 4]| faces.iter().any(|face| (face - value).abs() < 1e-9);
    let faces_x = [-1.0 - WALL, 1.0 + WALL, 16.0 - WALL, 18.0 + WALL];
    let faces_y = [-1.0 - WALL, 1.0 + WALL, 10.0 - WALL, 12.0 + WALL];
    if !at_corridor(x0, faces_x) {
        site.block([x0 - SKIN, y0, 0.0], [x0, y1, CEILING], Plaster);
    }
    if !at_corridor(x1, faces_x) {
        site.block([x1, y0, 0.0], [x1 + SKIN, y1, CEILING], Plaster);
    }
    if !at_corridor(y0, faces_y) {
        site.block([x0, y0 - SKIN, 0.0], [x1, y0, CEILING], Plaster);
    }
    if !at_corridor(y1, faces_y) {
        site.block([x0, y1, 0.0], [x1, y1 + SKIN, CEILING], Plaster);
    }
}

/// An air duct with hangers, cabinets and a radiator.
fn south_installations(site: &mut Site) {
    site.block([0.6, -0.92, 2.02], [15.8, -0.48, 2.36], Metal);
    for x in [2.0, 5.0, 8.0, 11.0, 14.0] {
        site.block([x, -0.96, 1.98], [x + 0.06, -0.44, CEILING], Metal);
    }
    site.block([7.6, 0.62, 0.0], [8.6, 1.0, 1.9], Metal);
    site.block([5.0, 0.86, 0.9], [5.5, 1.0, 1.6], Metal);
    site.block([11.2, -1.0, 0.15], [12.6, -0.88, 0.8], Metal);
    site.block([1.9, 0.86, 0.5], [2.08, 1.0, 1.05], Sign);
    pilasters(site, Along::X, &[3.9, 8.1, 12.9], [-1.0, -0.88]);
    // Sign across the corridor.
    site.block([9.4, -0.4, 2.15], [9.46, 0.5, 2.4], Sign);
    // End wall: switch cabinet beside the corner.
    site.block([17.72, -0.7, 0.3], [18.0, -0.1, 1.7], Metal);
}

/// Two pipes on brackets, an electrical cabinet and boxes on the floor.
fn east_installations(site: &mut Site) {
    site.block([17.74, -0.6, 2.2], [17.86, 11.6, 2.32], Metal);
    site.block([17.76, -0.6, 1.96], [17.84, 11.6, 2.04], Metal);
    for y in [0.6, 3.1, 5.0, 7.6, 10.0] {
        site.block([17.7, y, 1.9], [18.0, y + 0.08, 2.36], Metal);
    }
    site.block([16.0, 5.0, 0.0], [16.35, 6.1, 2.0], Metal);
    site.turned([17.66, 3.7, 0.25], [0.5, 0.45, 0.5], 20.0, Wood);
    site.turned([17.7, 4.3, 0.2], [0.4, 0.4, 0.4], -12.0, Wood);
    site.block([17.85, 7.9, 0.4], [18.0, 8.1, 0.95], Sign);
    pilasters(site, Along::Y, &[1.9, 9.2], [16.0, 16.12]);
    // End wall: a bench below a notice board.
    site.block([16.3, 11.65, 0.0], [17.3, 12.0, 0.45], Wood);
    site.block([16.2, 11.95, 1.1], [17.4, 12.0, 1.9], Wood);
}

/// A cable tray on brackets, a notice board and a trolley.
fn north_installations(site: &mut Site) {
    site.block([0.4, 10.1, 2.14], [15.8, 10.5, 2.2], Metal);
    for x in [1.4, 3.2, 6.8, 9.4, 11.2, 13.8, 15.2] {
        site.block([x, 10.0, 2.08], [x + 0.05, 10.52, 2.24], Metal);
    }
    site.block([7.0, 11.94, 0.9], [8.2, 12.0, 2.0], Wood);
    site.turned([4.0, 11.62, 0.5], [0.9, 0.5, 1.0], 8.0, Metal);
    site.block([12.4, 11.62, 0.0], [13.3, 12.0, 1.2], Metal);
    site.block([10.9, 10.0, 0.5], [11.1, 10.14, 1.05], Sign);
    pilasters(site, Along::X, &[5.2, 15.3], [11.88, 12.0]);
    site.block([3.0, 10.6, 2.15], [3.06, 11.4, 2.4], Sign);
    // End wall: a fire hose cabinet.
    site.block([-1.0, 10.6, 0.8], [-0.78, 11.3, 1.6], Sign);
}

/// A wide duct over half the way, lockers and an extinguisher.
fn west_installations(site: &mut Site) {
    site.block([-0.3, 5.2, 2.1], [0.3, 11.0, 2.42], Metal);
    site.block([-0.3, 5.2, 2.1], [1.0, 5.7, 2.42], Metal);
    site.block([0.62, 2.2, 0.0], [1.0, 4.1, 1.8], Metal);
    site.block([0.86, 8.2, 1.2], [1.0, 8.7, 1.9], Metal);
    site.block([-1.0, 6.3, 0.15], [-0.88, 7.5, 0.75], Metal);
    site.block([-1.0, 2.8, 0.5], [-0.85, 2.98, 1.05], Sign);
    pilasters(site, Along::Y, &[3.2, 10.1], [-1.0, -0.88]);
    // End wall: a cupboard and a crate.
    site.block([-0.9, -1.0, 0.0], [-0.2, -0.72, 1.5], Wood);
    site.turned([0.5, -0.75, 0.2], [0.4, 0.3, 0.4], 30.0, Wood);
}

fn pilasters(site: &mut Site, along: Along, places: &[f64], across: [f64; 2]) {
    for place in places {
        match along {
            Along::X => site.block([place - 0.2, across[0], 0.0], [place + 0.2, across[1], CEILING], Plaster),
            Along::Y => site.block([across[0], place - 0.2, 0.0], [across[1], place + 0.2, CEILING], Plaster),
        }
    }
}

fn lamps(site: &mut Site) {
    for x in [1.5, 4.5, 7.5, 10.5, 13.5] {
        site.block([x, -0.08, 2.44], [x + 1.2, 0.08, CEILING], Plaster);
        site.block([x + 0.6, 10.92, 2.44], [x + 1.8, 11.08, CEILING], Plaster);
    }
    for y in [1.8, 4.4, 7.0, 9.2] {
        site.block([16.92, y, 2.44], [17.08, y + 1.2, CEILING], Plaster);
    }
    for y in [1.6, 3.6] {
        site.block([-0.08, y, 2.44], [0.08, y + 1.2, CEILING], Plaster);
    }
}
