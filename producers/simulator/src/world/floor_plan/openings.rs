//! Doors, niches, windows and the rooms behind them.

use super::super::build::{Along, Filling, Opening, WALL};
use super::super::furniture;
use super::super::material::Material::Plaster;
use super::super::outline::{Rect, Run};
use super::Plan;

/// Thickness of a room's own walls, metres.
const SKIN: f64 = 0.1;

impl Plan {
    /// Draws the openings of a wall and builds what is behind them.
    pub(super) fn openings(&mut self, run: &Run) -> Vec<Opening> {
        let bare = self.bare_spans(run);
        let mut openings = Vec::new();
        let mut at = run.span[0] + self.random.within(0.9, 2.2);
        while at < run.span[1] - 0.9 {
            let width = if self.random.chance(0.25) { self.random.within(1.1, 1.6) } else { 0.95 };
            let free = bare.iter().all(|[low, high]| at + width / 2.0 < *low || at - width / 2.0 > *high);
            if free && at + width / 2.0 + 0.3 < run.span[1] {
                let opening = self.opening(run, at, width);
                openings.push(opening);
            }
            at += width + self.random.within(0.9, 3.6);
        }
        openings
    }

    fn opening(&mut self, run: &Run, at: f64, width: f64) -> Opening {
        let height = self.random.within(1.98, 2.12);
        let closed = Opening { at, width, height, filling: Filling::ClosedDoor };
        let kind = self.random.uniform();
        if kind < 0.5 {
            return closed;
        }
        if kind < 0.6 {
            return Opening { filling: Filling::Window, ..closed };
        }
        let niche = kind > 0.85;
        let depth = if niche { self.random.within(0.4, 1.0) } else { self.random.within(1.8, 4.0) };
        let aside =
            if niche { [0.0; 2] } else { [self.random.within(0.2, 1.2), self.random.within(0.2, 1.6)] };
        let span = [at - width / 2.0 - aside[0], at + width / 2.0 + aside[1]];
        let room = run.rect(span, [-WALL, -WALL - depth]);
        // Without the strip next to the corridor that it opens from.
        let body = run.rect([span[0] - SKIN, span[1] + SKIN], [-WALL - 0.35, -WALL - depth - SKIN]);
        let taken = self.corridors.iter().any(|corridor| body.overlaps(corridor, WALL + SKIN))
            || self.annexes.iter().any(|annexe| room.overlaps(annexe, 3.0 * SKIN));
        if taken {
            return closed;
        }
        self.annexes.push(room);
        self.room(run, &room);
        if niche {
            return Opening { filling: Filling::Nothing, ..closed };
        }
        let furnished = furniture::room(&mut self.random, &room, run.place(at, 0.0));
        self.site.solids.extend(furnished);
        // The leaf opens into the room.
        let degrees = run.outward * self.random.within(60.0, 88.0);
        Opening { filling: Filling::OpenDoor(degrees), ..closed }
    }

    /// Three thin walls; the fourth is the corridor's.
    fn room(&mut self, run: &Run, room: &Rect) {
        let Rect { min: [x0, y0], max: [x1, y1] } = *room;
        let open = match (run.along, run.outward > 0.0) {
            (Along::Y, true) => 0,
            (Along::Y, false) => 1,
            (Along::X, true) => 2,
            (Along::X, false) => 3,
        };
        let walls = [
            ([x0 - SKIN, y0 - SKIN], [x0, y1 + SKIN]),
            ([x1, y0 - SKIN], [x1 + SKIN, y1 + SKIN]),
            ([x0 - SKIN, y0 - SKIN], [x1 + SKIN, y0]),
            ([x0 - SKIN, y1], [x1 + SKIN, y1 + SKIN]),
        ];
        for (side, ([ax, ay], [bx, by])) in walls.into_iter().enumerate() {
            if side != open {
                self.site.block([ax, ay, 0.0], [bx, by, self.ceiling], Plaster);
            }
        }
    }
}
