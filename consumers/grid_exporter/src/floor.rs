//! How high the floor of a storey is, everywhere in its plan.
//!
//! Where the path passes a block, the floor is the ground right below it, or without any (on stairs: always) the path's height
//! less the sensor's; but where a stair leads over a floor of the storey, it is that floor. Elsewhere it is the ground that can be walked to from the path. Of several heights in one block that
//! nearest to the storey's own counts, and heights as high as another storey's never do: so each place has one height, stairs,
//! slopes and drift are followed, what lies between two storeys is on the plans of both, and a storey seen above or below
//! changes nothing. Blocks without any height (walls) have that of the nearest block that has one, up to [`BESIDE`] blocks away,
//! and all others the storey's.

use std::ops::Range;

use rustc_hash::{FxHashMap, FxHashSet};

use crate::raster::{Place, Raster, around};
use crate::reach::Reach;
use crate::walk::{Pass, Walk};

/// How far the height of a block reaches over blocks without any, in blocks: a wall and what stands before it.
const BESIDE: i32 = 3;
/// How far the ground may lie from the path less the measured height of the sensor, metres: the gait, and half a step.
const TREAD_M: f64 = 0.25;

/// How far a stair reaches to the sides of the path, in blocks squared: half the width of a wide one.
const STAIR_SIDE: i32 = 4;
/// Who climbs a stair this high above a floor leaves room to walk below it, metres.
const HEADROOM_M: f64 = 2.0;

/// Height of a block, and whether one climbs there.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Level {
    height: f64,
    stair: bool,
}

/// Height of a block that has one.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Own {
    level: f64,
    /// Whether the path passes.
    walked: bool,
    /// Whether it climbs here.
    stair: bool,
}

/// What heights are taken from.
#[derive(Clone, Copy)]
pub(crate) struct Sources<'a> {
    pub(crate) raster: Raster,
    pub(crate) walk: &'a Walk,
    pub(crate) reach: &'a Reach,
    /// Metres.
    pub(crate) sensor_height: f64,
}

/// The floor of one storey.
#[derive(Debug)]
pub(crate) struct Floor {
    /// Height of the storey, metres.
    level: f64,
    /// Heights that belong to it.
    span: Range<f64>,
    max_step: f64,
    own: FxHashMap<Place, Own>,
    /// Heights of the blocks that were asked for.
    levels: FxHashMap<Place, Level>,
}

impl Floor {
    /// A storey at `level`; `span` ends before its neighbours'.
    pub(crate) fn new(level: f64, span: Range<f64>, max_step: f64) -> Self {
        Self { level, span, max_step, own: FxHashMap::default(), levels: FxHashMap::default() }
    }

    /// Height of the storey, metres.
    pub(crate) fn storey(&self) -> f64 {
        self.level
    }

    /// Whether a floor of this height, metres, belongs to the storey.
    pub(crate) fn spans(&self, height: f64) -> bool {
        self.span.contains(&height)
    }

    /// Looks anew at blocks whose ground or path has changed. Gives the blocks at whose cells [`Self::at`] may have changed.
    pub(crate) fn update(&mut self, changed: &FxHashSet<Place>, sources: &Sources<'_>) -> FxHashSet<Place> {
        let mut affected = FxHashSet::default();
        for block in changed {
            let own = self.find(*block, sources);
            let before = match own {
                Some(own) => self.own.insert(*block, own),
                None => self.own.remove(block),
            };
            if before != own {
                affected.extend(around(*block, BESIDE));
            }
        }
        let mut moved = FxHashSet::default();
        for block in affected {
            let level = self.filled(block);
            let before = self.levels.get_mut(&block).map(|before| std::mem::replace(before, level));
            if before.is_some_and(|before| before != level) {
                // Between the centres of blocks the height changes steadily.
                moved.extend(around(block, 1));
            }
        }
        moved
    }

    /// Makes ready for [`Self::at`] in the cells from `low` to `high`, both included.
    pub(crate) fn prepare(&mut self, low: Place, high: Place, raster: Raster) {
        let ([x0, y0], [x1, y1]) = (raster.block(low), raster.block(high));
        for block in (y0 - 1..=y1 + 1).flat_map(|y| (x0 - 1..=x1 + 1).map(move |x| [x, y])) {
            if !self.levels.contains_key(&block) {
                let level = self.filled(block);
                self.levels.insert(block, level);
            }
        }
    }

    /// Height of the floor in a cell, metres: between the centres of blocks of one storey it changes steadily.
    pub(crate) fn at(&self, [x, y]: Place, raster: Raster) -> f64 {
        let size = f64::from(raster.block_cells);
        let [u, v] = [x, y].map(|cell| (f64::from(cell) + 0.5) / size - 0.5);
        let level = |x: i32, y: i32| self.levels.get(&[x, y]).map_or(self.level, |level| level.height);
        let [bx, by] = raster.block([x, y]);
        let own = level(bx, by);
        let (x0, y0) = (u.floor() as i32, v.floor() as i32);
        let (share_x, share_y) = (u - u.floor(), v - v.floor());
        let corner = |dx: i32, dy: i32| {
            let level = level(x0 + dx, y0 + dy);
            if (level - own).abs() <= self.max_step { level } else { own }
        };
        let along_x = |dy: i32| corner(0, dy) * (1.0 - share_x) + corner(1, dy) * share_x;
        along_x(0) * (1.0 - share_y) + along_x(1) * share_y
    }

    /// Whether somebody stood on this floor as the path passed a cell, at a place where it is `floor` high.
    pub(crate) fn carries(&self, pass: &Pass, floor: f64, sensor_height: f64) -> bool {
        (pass.height - sensor_height - floor).abs() <= self.max_step
    }

    /// Whether the path climbs in a block, or right beside it.
    pub(crate) fn is_stair(&self, block: Place) -> bool {
        self.levels.get(&block).is_some_and(|level| level.stair)
    }

    /// The height of a block by path and ground.
    fn find(&self, block: Place, sources: &Sources<'_>) -> Option<Own> {
        let &Sources { walk, reach, sensor_height, .. } = sources;
        let reached = self.nearest(reach.reached(block), |level| *level);
        let visits = walk.visits(block).map(|visit| (visit.height - sensor_height, visit.climbs));
        let visit = self.nearest(visits, |visit| visit.0).filter(|(path, _)| {
            let off = |height: f64| (height - self.level).abs();
            reached.is_none_or(|ground| off(*path) < off(ground) + HEADROOM_M)
        });
        let Some((path, stair)) = visit else {
            return reached.map(|level| Own { level, walked: false, stair: false });
        };
        // The ground seen on a stair is that before its first step.
        let ground = reach.surfaces(block).filter(|level| !stair && (level - path).abs() <= TREAD_M);
        let ground = ground.min_by(|a, b| (a - path).abs().total_cmp(&(b - path).abs()));
        Some(Own { level: ground.unwrap_or(path), walked: true, stair })
    }

    /// The first of those that belong to the storey and are nearest to it.
    fn nearest<T>(&self, all: impl Iterator<Item = T>, height: impl Fn(&T) -> f64) -> Option<T> {
        let off = |one: &T| (height(one) - self.level).abs();
        all.filter(|one| self.span.contains(&height(one))).min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// The height of a block, its own or that of the nearest one that has one; of several equally near
    /// one that the path passes, then that nearest to the storey's, then the lowest.
    fn filled(&self, block: Place) -> Level {
        let rank = |place: Place| {
            let own = self.own.get(&place)?;
            let [dx, dy] = [0, 1].map(|axis: usize| place[axis] - block[axis]);
            Some((dx * dx + dy * dy, own))
        };
        let off = |own: &Own| (own.level - self.level).abs();
        let nearest = rank(block).or_else(|| {
            around(block, BESIDE).filter_map(rank).min_by(|(a_far, a), (b_far, b)| {
                (a_far, !a.walked)
                    .cmp(&(b_far, !b.walked))
                    .then(off(a).total_cmp(&off(b)))
                    .then(a.level.total_cmp(&b.level))
            })
        });
        // The path enters and leaves a stair in the middle of a block: its first steps count as stair, too.
        let beside = || around(block, 1).filter_map(|place| self.own.get(&place)).any(|own| own.stair);
        nearest.map_or(Level { height: self.level, stair: false }, |(far, own)| Level {
            height: own.level,
            stair: own.stair && far <= STAIR_SIDE || far == 0 && own.walked && beside(),
        })
    }
}
