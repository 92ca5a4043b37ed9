//! A station hall of 34 x 20 m, 5 m high: pillars, a stair to a gallery, ticket machines, gates, a kiosk, and six people
//! who walk.

use super::build::{Along, Opening, Site, WALL, door, passage};
use super::material::Material::{Concrete, Glass, Metal, Plaster, Sign, Wood};
use super::people::Person;
use crate::trajectory::Route;

const CEILING: f64 = 5.0;
const STOREY: [f64; 2] = [0.0, CEILING];
const PILLARS_X: [f64; 4] = [7.0, 13.0, 19.0, 25.0];
const PILLARS_Y: [f64; 2] = [6.0, 14.0];
const GALLERY: f64 = 2.72;

/// Down the middle, up the north side, back, past the ticket machines and to the middle again.
pub(super) fn route(start: impl Fn([f64; 3], f64) -> Route) -> Route {
    start([4.0, 10.0, 0.0], 0.0)
        .stand(3.0)
        .walk_to(22.0, 10.0)
        .walk_to(22.0, 17.0)
        .walk_to(10.0, 17.0)
        .stand(1.5)
        .walk_to(10.0, 2.8)
        .walk_to(16.0, 2.8)
        .walk_to(16.0, 10.0)
        .walk_to(8.0, 10.0)
        .turn(180.0)
        .stand(1.0)
}

pub(super) fn build() -> Site {
    let mut site = Site::default();
    site.block([-6.0, -6.0, -0.3], [40.0, 26.0, 0.0], Concrete);
    site.block([-6.0, -6.0, CEILING], [40.0, 26.0, CEILING + 0.3], Concrete);
    walls(&mut site);
    pillars_and_beams(&mut site);
    gallery(&mut site);
    furniture(&mut site);
    people(&mut site);
    site
}

fn walls(site: &mut Site) {
    let exit = |at: f64| passage(at, 2.4, 2.6);
    let window = |at: f64| Opening { at, width: 2.2, height: 2.6, filling: super::build::Filling::Window };
    let south = [door(3.0), door(19.5), exit(24.0), window(30.0)];
    site.wall(Along::X, [-WALL, 34.0 + WALL], [-WALL, 0.0], STOREY, &south);
    let north = [window(9.5), window(13.5), door(18.0), exit(22.5), door(28.5)];
    site.wall(Along::X, [-WALL, 34.0 + WALL], [20.0, 20.0 + WALL], STOREY, &north);
    site.wall(Along::Y, [0.0, 20.0], [-WALL, 0.0], STOREY, &[door(5.0), exit(10.0), window(13.8)]);
    site.wall(Along::Y, [0.0, 20.0], [34.0, 34.0 + WALL], STOREY, &[door(3.0), exit(16.5)]);
    // Lobbies behind the exits end at closed shutters; the street behind the windows is a wall 3 m away.
    site.block([-6.0, -6.0, 0.0], [40.0, -5.7, CEILING], Plaster);
    site.block([-6.0, 25.7, 0.0], [40.0, 26.0, CEILING], Plaster);
    site.block([-6.0, -6.0, 0.0], [-5.7, 26.0, CEILING], Plaster);
    site.block([39.7, -6.0, 0.0], [40.0, 26.0, CEILING], Plaster);
    site.block([22.6, -2.3, 0.0], [25.4, -2.2, 2.8], Metal);
    site.block([21.1, 22.2, 0.0], [23.9, 22.3, 2.8], Metal);
    site.block([-2.3, 8.6, 0.0], [-2.2, 11.4, 2.8], Metal);
    site.block([36.2, 15.1, 0.0], [36.3, 17.9, 2.8], Metal);
    for x in [5.5, 16.0, 27.0] {
        site.block([x, 0.0, 0.0], [x + 0.5, 0.2, CEILING], Plaster);
        site.block([x - 1.0, 19.8, 0.0], [x - 0.5, 20.0, CEILING], Plaster);
    }
}

fn pillars_and_beams(site: &mut Site) {
    for x in PILLARS_X {
        for y in PILLARS_Y {
            site.block([x - 0.35, y - 0.35, 0.0], [x + 0.35, y + 0.35, CEILING], Concrete);
            // A skirting, so that a pillar is not a mere box.
            site.block([x - 0.4, y - 0.4, 0.0], [x + 0.4, y + 0.4, 0.15], Concrete);
        }
        site.block([x - 0.25, 0.0, 4.5], [x + 0.25, 20.0, CEILING], Concrete);
        site.block([x + 2.9, 2.0, 4.2], [x + 3.1, 18.0, 4.3], Metal);
    }
    site.block([2.0, 8.4, 3.9], [33.0, 8.9, 4.4], Metal);
    // Hanging signs and clocks.
    site.block([10.0, 9.0, 2.6], [10.15, 11.0, 3.1], Sign);
    site.block([18.0, 9.2, 2.6], [18.15, 10.8, 3.1], Sign);
    site.block([21.0, 15.2, 2.6], [23.0, 15.3, 3.0], Sign);
}

fn gallery(site: &mut Site) {
    site.flight([26.0, 8.0, 0.0], 4.0, 16, [0.3, 0.17], 3.0);
    site.block([30.8, 5.0, GALLERY - 0.4], [34.0, 15.0, GALLERY], Concrete);
    for y in [5.4, 14.6] {
        site.block([31.0, y - 0.2, 0.0], [31.4, y + 0.2, GALLERY - 0.4], Concrete);
    }
    site.block([30.8, 5.0, GALLERY], [30.85, 8.0, GALLERY + 1.0], Glass);
    site.block([30.8, 12.0, GALLERY], [30.85, 15.0, GALLERY + 1.0], Glass);
    // Handrails on posts beside the flight.
    for (x, step) in [(26.15, 1.0), (27.35, 5.0), (28.55, 9.0), (29.75, 13.0)] {
        for y in [8.0, 11.95] {
            site.block([x, y, 0.17 * step], [x + 0.05, y + 0.05, 0.17 * step + 0.95], Metal);
            site.block([x, y, 0.17 * step + 0.9], [x + 1.2, y + 0.05, 0.17 * step + 1.4], Metal);
        }
    }
}

fn furniture(site: &mut Site) {
    // Ticket machines.
    for x in [8.2, 9.4, 10.6, 11.8, 13.0] {
        site.block([x, 0.0, 0.0], [x + 0.85, 0.65, 1.85], Metal);
        site.block([x + 0.2, 0.65, 1.0], [x + 0.65, 0.72, 1.5], Sign);
    }
    // Gates.
    for y in [2.2, 3.2, 4.2, 5.2] {
        site.block([19.6, y, 0.0], [21.2, y + 0.25, 1.0], Metal);
    }
    // Kiosk with a counter.
    site.turned([2.8, 16.8, 1.3], [3.2, 2.6, 2.6], 12.0, Wood);
    site.turned([4.9, 15.6, 0.55], [0.6, 2.0, 1.1], 12.0, Wood);
    // Benches, bins, advertising boards, a planter.
    for (x, y) in [(13.0, 7.0), (19.0, 13.0), (25.0, 7.0), (7.0, 13.0)] {
        site.block([x - 0.9, y - 0.25, 0.35], [x + 0.9, y + 0.25, 0.45], Wood);
        site.block([x - 0.8, y - 0.2, 0.0], [x - 0.7, y + 0.2, 0.35], Metal);
        site.block([x + 0.7, y - 0.2, 0.0], [x + 0.8, y + 0.2, 0.35], Metal);
    }
    site.turned([16.2, 15.0, 0.9], [1.4, 0.15, 1.8], 30.0, Sign);
    site.turned([4.5, 6.2, 0.9], [1.4, 0.15, 1.8], -40.0, Sign);
    site.turned([28.0, 16.5, 0.4], [1.6, 1.6, 0.8], 20.0, Wood);
    site.turned([28.0, 16.5, 1.2], [0.9, 0.9, 0.9], 50.0, Wood);
    site.block([22.0, 19.3, 0.0], [22.4, 19.7, 0.9], Metal);
    site.block([32.6, 0.4, 0.0], [33.6, 1.2, 2.0], Metal);
    site.block([0.0, 1.0, 0.0], [0.5, 4.0, 2.1], Metal);
}

fn people(site: &mut Site) {
    site.people = vec![
        Person::new(&[[8.5, 12.0], [23.5, 12.0], [23.5, 11.5], [8.5, 11.5]], 1.2, 12.0),
        Person::new(&[[17.5, 8.0], [17.5, 4.0], [17.2, 4.0], [17.2, 8.0]], 0.9, 2.0),
        Person::new(&[[14.5, 18.6], [26.0, 18.6], [26.0, 18.3], [14.5, 18.3]], 1.1, 20.0),
        Person::new(&[[3.0, 7.5], [11.0, 7.9], [11.0, 8.2], [3.0, 8.0]], 1.0, 6.0),
        Person::new(&[[23.4, 2.0], [23.4, 9.0], [24.0, 9.0], [24.0, 2.0]], 1.3, 0.0),
        Person::new(&[[5.4, 18.8], [8.0, 18.8], [8.6, 15.2], [8.3, 15.2]], 0.8, 3.0),
    ];
}
