//! The shell of one large room.

use super::build::{Along, Opening, Site, WALL};
use super::material::Material::{Concrete, Metal};
use super::outline::Rect;

/// Floor, ceiling and four walls around a rectangle, `height` metres high; openings of the south, north, west and east
/// wall are closed by shutters a metre behind them.
pub(super) fn shell(site: &mut Site, room: &Rect, height: f64, openings: [&[Opening]; 4]) {
    let Rect { min: [x0, y0], max: [x1, y1] } = *room;
    let out = 3.0;
    site.block([x0 - out, y0 - out, -0.3], [x1 + out, y1 + out, 0.0], Concrete);
    site.block([x0 - out, y0 - out, height], [x1 + out, y1 + out, height + 0.3], Concrete);
    let storey = [0.0, height];
    site.wall(Along::X, [x0 - WALL, x1 + WALL], [y0 - WALL, y0], storey, openings[0]);
    site.wall(Along::X, [x0 - WALL, x1 + WALL], [y1, y1 + WALL], storey, openings[1]);
    site.wall(Along::Y, [y0, y1], [x0 - WALL, x0], storey, openings[2]);
    site.wall(Along::Y, [y0, y1], [x1, x1 + WALL], storey, openings[3]);
    site.block([x0 - 1.4, y0 - 1.4, 0.0], [x1 + 1.4, y0 - 1.3, height], Metal);
    site.block([x0 - 1.4, y1 + 1.3, 0.0], [x1 + 1.4, y1 + 1.4, height], Metal);
    site.block([x0 - 1.4, y0 - 1.4, 0.0], [x0 - 1.3, y1 + 1.4, height], Metal);
    site.block([x1 + 1.3, y0 - 1.4, 0.0], [x1 + 1.4, y1 + 1.4, height], Metal);
}
