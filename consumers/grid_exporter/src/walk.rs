//! Where the sensor has been: what the plan knows of floors that nobody has seen, and of storeys.

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

use crate::raster::{Place, Raster, around};

/// Metres between two positions that count.
const SPACING_M: f64 = 0.1;
/// The path says this far to each side that there is a floor, metres: half the width of who carries the sensor.
const WALKED_M: f64 = 0.25;
/// A path that changes its height by more than this within a block is on a stair, metres: the gait does not.
const CLIMB_M: f64 = 0.12;
/// Heights of the path that are told apart, metres: what is walked again at the same height takes no more memory.
const HEIGHT_M: f64 = 0.05;
/// Edge of the histogram's bins, metres. The first position lies in the middle of one.
pub(crate) const BIN_M: f64 = 0.2;

/// The path within one block, from entering to leaving it.
#[derive(Debug, Clone, Copy)]
struct Stay {
    block: Place,
    sum: f64,
    points: u32,
    low: f64,
    high: f64,
}

impl Stay {
    fn visit(&self) -> Visit {
        Visit {
            height: rounded(self.sum / f64::from(self.points.max(1))),
            climbs: self.high - self.low > CLIMB_M,
        }
    }
}

/// How the path passed a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Visit {
    /// Of the sensor, metres.
    pub(crate) height: f64,
    /// Whether it was on a stair.
    pub(crate) climbs: bool,
}

/// How the path passed a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pass {
    /// Of the sensor, metres.
    pub(crate) height: f64,
    /// The block in which the sensor was.
    pub(crate) block: Place,
}

/// How much of the path lies in a span of heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bin {
    /// Positions.
    pub(crate) points: u32,
    /// Number of the stay that was there first.
    pub(crate) first: u32,
}

/// The path, as far as it matters. It grows with the area that is walked, not with the time.
#[derive(Debug)]
pub(crate) struct Walk {
    raster: Raster,
    start: Option<f64>,
    last: Option<[f64; 3]>,
    stay: Option<Stay>,
    stays: u32,
    visits: FxHashMap<Place, Vec<Visit>>,
    passes: FxHashMap<Place, Vec<Pass>>,
    /// Positions on even floors by height.
    heights: BTreeMap<i32, Bin>,
    changed_blocks: Vec<Place>,
    changed_cells: Vec<Place>,
}

impl Walk {
    pub(crate) fn new(raster: Raster) -> Self {
        Self {
            raster,
            start: None,
            last: None,
            stay: None,
            stays: 0,
            visits: FxHashMap::default(),
            passes: FxHashMap::default(),
            heights: BTreeMap::new(),
            changed_blocks: Vec::new(),
            changed_cells: Vec::new(),
        }
    }

    /// Takes a finite position, metres.
    pub(crate) fn push(&mut self, position: [f64; 3]) {
        let step = self.last.map_or(f64::INFINITY, |last| {
            last.iter().zip(position).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
        });
        if step < SPACING_M {
            return;
        }
        self.last = Some(position);
        let [x, y, z] = position;
        self.start.get_or_insert(z);
        let cell = [self.raster.cell(x), self.raster.cell(y)];
        let block = self.raster.block(cell);
        match &mut self.stay {
            Some(stay) if stay.block == block => {
                stay.sum += z;
                stay.points += 1;
                (stay.low, stay.high) = (stay.low.min(z), stay.high.max(z));
            }
            _ => {
                self.end_stay();
                self.stay = Some(Stay { block, sum: z, points: 1, low: z, high: z });
            }
        }
        self.changed_blocks.push(block);
        self.pass(cell, Pass { height: rounded(z), block });
    }

    fn end_stay(&mut self) {
        let Some(stay) = self.stay.take() else { return };
        let (visit, number) = (stay.visit(), self.stays);
        self.stays = self.stays.saturating_add(1);
        if !visit.climbs {
            let bin = self.bin(visit.height);
            let bin = self.heights.entry(bin).or_insert(Bin { points: 0, first: number });
            bin.points = bin.points.saturating_add(stay.points);
        }
        let visits = self.visits.entry(stay.block).or_default();
        if !visits.contains(&visit) {
            visits.push(visit);
        }
        self.changed_blocks.push(stay.block);
    }

    fn pass(&mut self, [x, y]: Place, pass: Pass) {
        let reach = (WALKED_M / self.raster.resolution).floor() as i32;
        for cell in around([x, y], reach) {
            let [dx, dy] = [cell[0] - x, cell[1] - y];
            let passes = self.passes.entry(cell).or_default();
            if dx * dx + dy * dy <= reach * reach && !passes.contains(&pass) {
                passes.push(pass);
                self.changed_cells.push(cell);
            }
        }
    }

    fn bin(&self, height: f64) -> i32 {
        ((height - self.start.unwrap_or_default()) / BIN_M).round() as i32
    }

    /// The height in the middle of a bin, metres.
    pub(crate) fn bin_height(&self, bin: i32) -> f64 {
        self.start.unwrap_or_default() + f64::from(bin) * BIN_M
    }

    /// How long the even parts of the path are by height, in bins; the stay that lasts counts only while it is the only one.
    pub(crate) fn heights(&self) -> BTreeMap<i32, Bin> {
        if !self.heights.is_empty() {
            return self.heights.clone();
        }
        let stay = self.stay.iter().map(|stay| (self.bin(stay.visit().height), Bin { points: 1, first: 0 }));
        stay.collect()
    }

    /// How the path passed a block, in the order of time.
    pub(crate) fn visits(&self, block: Place) -> impl Iterator<Item = Visit> {
        let ended = self.visits.get(&block).map_or(&[][..], Vec::as_slice);
        let lasting = self.stay.filter(|stay| stay.block == block).map(|stay| stay.visit());
        ended.iter().copied().chain(lasting)
    }

    /// How the path passed a cell.
    pub(crate) fn passes(&self, cell: Place) -> &[Pass] {
        self.passes.get(&cell).map_or(&[], Vec::as_slice)
    }

    /// Height of the newest position, metres.
    pub(crate) fn height(&self) -> Option<f64> {
        self.last.map(|[_, _, z]| z)
    }

    /// The blocks and cells that the path has passed anew since the last call.
    pub(crate) fn take_changes(&mut self) -> (Vec<Place>, Vec<Place>) {
        (std::mem::take(&mut self.changed_blocks), std::mem::take(&mut self.changed_cells))
    }

    /// All blocks and cells that the path has passed.
    pub(crate) fn all(&self) -> (Vec<Place>, Vec<Place>) {
        let lasting = self.stay.map(|stay| stay.block);
        (self.visits.keys().copied().chain(lasting).collect(), self.passes.keys().copied().collect())
    }
}

fn rounded(height: f64) -> f64 {
    (height / HEIGHT_M).round() * HEIGHT_M
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(positions: impl IntoIterator<Item = [f64; 3]>) -> Walk {
        let mut walk = Walk::new(Raster::new(0.1));
        positions.into_iter().for_each(|position| walk.push(position));
        walk
    }

    #[test]
    fn walking_the_same_way_for_an_hour_takes_no_more_memory_than_once() {
        let lap = || (0..400).map(|i| f64::from(i) * 0.01).flat_map(|x| [[x, 0.0, 1.0]]);
        let back = || lap().map(|[x, y, z]| [4.0 - x, y, z]);
        let size = |walk: &Walk| {
            let visits: usize = walk.visits.values().map(Vec::len).sum();
            (visits, walk.passes.values().map(Vec::len).sum::<usize>())
        };
        let twice = walk(lap().chain(back()).chain(lap()).chain(back()));
        let often = walk((0..100).flat_map(|_| lap().chain(back())));
        assert_eq!(size(&often), size(&twice));
        assert!(often.heights[&0].points > 30 * twice.heights[&0].points);
    }

    #[test]
    fn a_stair_climbs_and_is_no_storey_and_a_ramp_is_not_a_stair() {
        let rise =
            |slope: f64| walk((0..100).map(move |i| [f64::from(i) * 0.1, 0.0, f64::from(i) * 0.1 * slope]));
        let (stair, ramp) = (rise(0.6), rise(0.1));
        assert!(stair.visits([4, 0]).all(|visit| visit.climbs));
        assert!(stair.heights().values().map(|bin| bin.points).sum::<u32>() < 10);
        assert!(ramp.visits([4, 0]).all(|visit| !visit.climbs));
        assert!(ramp.heights().values().map(|bin| bin.points).sum::<u32>() > 80);
    }
}
