//! What stands at, hangs on and runs along the corridors' walls.

use super::super::build::{Along, Opening};
use super::super::material::Material::{self, Metal, Plaster, Sign, Stone, Wood};
use super::super::outline::{Rect, Run};
use super::super::solid::Solid;
use super::{CLEAR_OF_WAY, Plan, Style};

/// Below this things are in the way of a walker, metres.
const HEADROOM: f64 = 1.95;

/// A box at a wall: width along it, depth from it, both heights.
struct Fitting {
    width: f64,
    depth: f64,
    height: [f64; 2],
    material: Material,
}

impl Plan {
    /// Fits a wall out between its openings.
    pub(super) fn fit(&mut self, run: &Run, openings: &[Opening]) {
        let bare = self.bare_spans(run);
        let mut at = run.span[0] + self.random.within(0.1, 1.5);
        while at < run.span[1] - 0.4 {
            let fitting = self.draw_fitting();
            let span = [at, (at + fitting.width).min(run.span[1])];
            let off = |low: f64, high: f64| span[1] < low || span[0] > high;
            let free = openings
                .iter()
                .all(|door| off(door.at - door.width / 2.0 - 0.1, door.at + door.width / 2.0 + 0.1));
            if free && bare.iter().all(|[low, high]| off(*low, *high)) {
                self.mount(run, span, &fitting);
            }
            at = span[1] + self.random.within(0.2, 2.2);
        }
        if self.style == Style::Cellar {
            self.rubble(run);
        }
    }

    fn draw_fitting(&mut self) -> Fitting {
        let ceiling = self.ceiling;
        let random = &mut self.random;
        let mut fitting = |width: [f64; 2], depth: [f64; 2], height: [f64; 2], material| Fitting {
            width: random.within(width[0], width[1]),
            depth: random.within(depth[0], depth[1]),
            height,
            material,
        };
        let stone = if self.style == Style::Cellar { Stone } else { Plaster };
        let drawn = [
            fitting([0.6, 1.5], [0.15, 0.45], [0.0, 1.9], Metal),
            fitting([0.4, 0.8], [0.08, 0.2], [0.8, 1.6], Metal),
            fitting([0.9, 1.6], [0.08, 0.13], [0.12, 0.75], Metal),
            fitting([0.15, 0.22], [0.1, 0.16], [0.5, 1.05], Sign),
            fitting([0.3, 0.6], [0.08, 0.25], [0.0, ceiling], stone),
            fitting([0.8, 1.8], [0.04, 0.07], [0.9, 1.95], Wood),
            fitting([0.4, 0.7], [0.3, 0.5], [0.0, 0.5], Wood),
            fitting([1.0, 1.8], [0.3, 0.4], [0.0, 0.45], Wood),
        ];
        let which = random.below(drawn.len());
        let [fitting, ..] = &drawn;
        let Fitting { width, depth, height, material } = *drawn.get(which).unwrap_or(fitting);
        let top = height[1] * if height[1] < ceiling { random.within(0.8, 1.0) } else { 1.0 };
        Fitting { width, depth, height: [height[0], top], material }
    }

    /// Puts it up where it leaves the way free, thinner where the corridor is narrow.
    fn mount(&mut self, run: &Run, span: [f64; 2], fitting: &Fitting) {
        for depth in [fitting.depth, fitting.depth / 2.0, 0.06] {
            let rect = run.rect(span, [0.0, depth]);
            if fitting.height[0] > HEADROOM || self.tour.distance(&rect) > CLEAR_OF_WAY {
                let [x0, y0] = rect.min;
                let [x1, y1] = rect.max;
                let [low, high] = fitting.height;
                self.site.block([x0, y0, low], [x1, y1, high], fitting.material);
                return;
            }
        }
    }

    /// Ducts, trays, lamps and beams.
    pub(super) fn fit_out(&mut self) {
        for corridor in self.corridors.clone() {
            let long_x = corridor.max[0] - corridor.min[0] > corridor.max[1] - corridor.min[1];
            let along = if long_x { Along::X } else { Along::Y };
            self.overhead(&corridor, along);
            self.lamps(&corridor, along);
        }
    }

    fn overhead(&mut self, corridor: &Rect, along: Along) {
        let (a, c) = if along == Along::X { (0, 1) } else { (1, 0) };
        let span = [corridor.min[a] + 0.3, corridor.max[a] - 0.3];
        let right = self.random.chance(0.5);
        let (width, height) = (self.random.within(0.25, 0.5), self.random.within(0.06, 0.35));
        let gap = self.random.within(0.03, 0.15);
        let across = if right {
            [corridor.max[c] - gap - width, corridor.max[c] - gap]
        } else {
            [corridor.min[c] + gap, corridor.min[c] + gap + width]
        };
        let top = self.ceiling - self.random.within(0.03, 0.15);
        let bottom = (top - height).max(HEADROOM + 0.05);
        let corner = |s: f64, q: f64, z: f64| if along == Along::X { [s, q, z] } else { [q, s, z] };
        if self.style == Style::Cellar && self.random.chance(0.6) {
            let radius = self.random.within(0.05, 0.14);
            let (q, z) = (across[0] + width / 2.0, self.ceiling - radius - 0.06);
            self.site.solids.push(Solid::pipe(corner(span[0], q, z), corner(span[1], q, z), radius, Metal));
        } else {
            self.site.block(corner(span[0], across[0], bottom), corner(span[1], across[1], top), Metal);
        }
        // Hangers, or joists right across.
        let pitch = self.random.within(1.2, 3.0);
        let beams = self.random.chance(0.3);
        let beam = self.ceiling - self.random.within(0.1, 0.25);
        let mut at = span[0] + self.random.within(0.2, 1.0);
        while at < span[1] - 0.2 {
            if beams {
                let (low, high) = (corridor.min[c], corridor.max[c]);
                self.site.block(
                    corner(at, low, beam.max(2.0)),
                    corner(at + 0.15, high, self.ceiling),
                    Plaster,
                );
            } else {
                let hanger = [across[0] - 0.02, across[1] + 0.02];
                self.site.block(
                    corner(at, hanger[0], bottom - 0.04),
                    corner(at + 0.06, hanger[1], self.ceiling),
                    Metal,
                );
            }
            at += pitch;
        }
    }

    fn lamps(&mut self, corridor: &Rect, along: Along) {
        let (a, c) = if along == Along::X { (0, 1) } else { (1, 0) };
        let middle = (corridor.min[c] + corridor.max[c]) / 2.0;
        let pitch = self.random.within(2.0, 4.0);
        let mut at = corridor.min[a] + self.random.within(0.5, 2.0);
        while at < corridor.max[a] - 1.2 {
            let corner = |s: f64, q: f64, z: f64| if along == Along::X { [s, q, z] } else { [q, s, z] };
            let low = corner(at, middle - 0.08, self.ceiling - 0.07);
            self.site.block(low, corner(at + 1.1, middle + 0.08, self.ceiling), Plaster);
            at += pitch;
        }
    }

    /// Barrels, fallen stones and leaning props at the foot of a wall.
    fn rubble(&mut self, run: &Run) {
        let pieces = (run.length() * 1.2) as usize;
        for _ in 0..pieces {
            let at = self.random.within(run.span[0] + 0.2, run.span[1] - 0.2);
            let size = self.random.within(0.05, 0.3);
            let [x, y] = run.place(at, size * self.random.within(0.3, 1.0));
            let rect = Rect::around([x, y], [x, y], size * 0.9);
            if self.tour.distance(&rect) < CLEAR_OF_WAY {
                continue;
            }
            let solid = match self.random.below(6) {
                0 => Solid::pipe([x, y, 0.0], [x, y, 0.9], (size * 0.9).max(0.12), Wood),
                1 => Solid::ball([x, y, size * 0.3], size * 0.6, Stone),
                2 => Solid::pipe([x, y, 0.0], [x, y, self.ceiling], size * 0.3, Wood),
                _ => {
                    let turn = [0; 3].map(|_| self.random.within(-40.0, 40.0));
                    Solid::tilted([x, y, size * 0.4], [size, size * 0.8, size * 0.9], turn, Stone)
                }
            };
            self.site.solids.push(solid);
        }
    }
}
