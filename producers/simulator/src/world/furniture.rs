//! Furniture, plants and vessels, put together from simple bodies.

use crate::random::Random;

use super::material::Material::{Cloth, Leaves, Metal, Wood};
use super::outline::Rect;
use super::solid::Solid;

/// A table with four legs: centre on the floor, size over all, turned by degrees.
pub(super) fn table(centre: [f64; 2], [length, width, height]: [f64; 3], degrees: f64) -> Vec<Solid> {
    let on = frame(centre, degrees);
    let [x, y] = centre;
    let mut parts = vec![Solid::turned([x, y, height - 0.015], [length, width, 0.03], degrees, Wood)];
    for (dx, dy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let [lx, ly] = on(dx * (length / 2.0 - 0.05), dy * (width / 2.0 - 0.05));
        parts.push(Solid::turned(
            [lx, ly, (height - 0.03) / 2.0],
            [0.04, 0.04, height - 0.03],
            degrees,
            Metal,
        ));
    }
    parts
}

/// A chair with thin legs, its back against the direction that it faces.
pub(super) fn chair(centre: [f64; 2], degrees: f64) -> Vec<Solid> {
    let on = frame(centre, degrees);
    let [x, y] = centre;
    let mut parts = vec![Solid::turned([x, y, 0.45], [0.42, 0.42, 0.06], degrees, Cloth)];
    for (dx, dy) in [(-0.18, -0.18), (-0.18, 0.18), (0.18, -0.18), (0.18, 0.18)] {
        let [lx, ly] = on(dx, dy);
        parts.push(Solid::pipe([lx, ly, 0.0], [lx, ly, 0.43], 0.013, Metal));
    }
    let [bx, by] = on(-0.2, 0.0);
    parts.push(Solid::turned([bx, by, 0.72], [0.04, 0.4, 0.34], degrees, Cloth));
    parts
}

/// An open shelf full of books: many small boxes of uneven height and depth. It faces along `degrees`.
pub(super) fn shelf(
    random: &mut Random,
    centre: [f64; 2],
    [length, depth, height]: [f64; 3],
    degrees: f64,
) -> Vec<Solid> {
    let on = frame(centre, degrees);
    let mut parts = Vec::new();
    // Its x axis looks into the room, its boards run along y.
    let part = |along: [f64; 2], out: [f64; 2], up: [f64; 2], material| {
        let [x, y] = on((out[0] + out[1]) / 2.0, (along[0] + along[1]) / 2.0);
        let size = [out[1] - out[0], along[1] - along[0], up[1] - up[0]];
        Solid::turned([x, y, (up[0] + up[1]) / 2.0], size, degrees, material)
    };
    let (half, back) = (length / 2.0, -depth / 2.0);
    parts.push(part([-half, half], [back, back + 0.02], [0.0, height], Wood));
    parts.push(part([-half, -half + 0.03], [back, depth / 2.0], [0.0, height], Wood));
    parts.push(part([half - 0.03, half], [back, depth / 2.0], [0.0, height], Wood));
    let mut board = 0.05;
    while board < height - 0.2 {
        parts.push(part([-half, half], [back, depth / 2.0], [board, board + 0.03], Wood));
        let mut at = -half + 0.04;
        while at < half - 0.2 {
            let width = random.within(0.08, 0.35);
            if random.chance(0.8) {
                let front = back + depth * random.within(0.5, 0.95);
                let top = board + 0.03 + random.within(0.15, 0.27);
                parts.push(part(
                    [at, (at + width).min(half - 0.04)],
                    [back + 0.02, front],
                    [board + 0.03, top],
                    Cloth,
                ));
            }
            at += width + random.within(0.0, 0.08);
        }
        board += 0.36;
    }
    parts
}

/// A plant in a pot: a stem and a cloud of leaves, height over all in metres.
pub(super) fn plant(random: &mut Random, [x, y]: [f64; 2], height: f64) -> Vec<Solid> {
    let mut parts = vec![
        Solid::pipe([x, y, 0.0], [x, y, 0.35], 0.18, Metal),
        Solid::pipe([x, y, 0.35], [x, y, height * 0.75], 0.02, Wood),
    ];
    let spread = 0.28 * height.min(1.6);
    for _ in 0..40 {
        let [a, b, c] = random.normals().map(|value| value.clamp(-2.0, 2.0) * 0.45);
        let centre = [x + a * spread, y + b * spread, height * 0.7 + c * height * 0.3];
        if random.chance(0.5) {
            parts.push(Solid::ball(centre, random.within(0.02, 0.06), Leaves));
        } else {
            let turn = [0; 3].map(|_| random.within(-90.0, 90.0));
            parts.push(Solid::tilted(centre, [random.within(0.06, 0.2), 0.05, 0.004], turn, Leaves));
        }
    }
    parts
}

/// An upright tank with a domed top.
pub(super) fn tank([x, y]: [f64; 2], radius: f64, height: f64) -> Vec<Solid> {
    vec![
        Solid::pipe([x, y, 0.12], [x, y, height], radius, Metal),
        Solid::pipe([x, y, 0.0], [x, y, 0.12], radius * 1.1, Metal),
        Solid::ball([x, y, height - radius * 0.5], radius * 1.05, Metal),
    ]
}

/// What is in a room that is seen through its door: a shelf at the far end, a table or crates, away from the door.
pub(super) fn room(random: &mut Random, room: &Rect, door: [f64; 2]) -> Vec<Solid> {
    let mut parts = Vec::new();
    let size = [room.max[0] - room.min[0], room.max[1] - room.min[1]];
    for _ in 0..4 {
        let place = [0, 1].map(|i| random.within(room.min[i] + 0.3, room.max[i] - 0.3));
        if (place[0] - door[0]).hypot(place[1] - door[1]) < 1.7 {
            continue;
        }
        let [x, y] = place;
        let height = random.within(0.5, 1.9);
        match random.below(3) {
            0 if size[0].min(size[1]) > 2.0 => {
                parts.extend(table(place, [0.9, 0.6, 0.74], random.within(-20.0, 20.0)))
            }
            1 => parts.push(Solid::turned(
                [x, y, height / 2.0],
                [0.55, 0.5, height],
                random.within(-30.0, 30.0),
                Metal,
            )),
            _ => {
                let edge = random.within(0.3, 0.6);
                parts.push(Solid::turned(
                    [x, y, edge / 2.0],
                    [edge, edge, edge],
                    random.within(-40.0, 40.0),
                    Wood,
                ));
            }
        }
    }
    parts
}

/// From coordinates of a piece of furniture to the floor.
fn frame([x, y]: [f64; 2], degrees: f64) -> impl Fn(f64, f64) -> [f64; 2] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    move |dx, dy| [x + cos * dx - sin * dy, y + sin * dx + cos * dy]
}
