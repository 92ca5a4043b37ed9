//! Points that counts alone do not settle: they wait with their places until the cloud was read once more.

use rustc_hash::FxHashMap;

use super::counts::{Counts, neighbourhood, split};

/// A point and the others found within its radius so far; itself is among them, as the cloud is read whole.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    point: [f32; 3],
    found: u8,
}

/// A batch of undecided points.
#[derive(Debug)]
pub(super) struct Undecided {
    radius_squared: f32,
    /// Others that suffice.
    enough: u8,
    points: Vec<Waiting>,
    /// Where the points of a block begin and end, after [`Self::arrange`]; also of blocks without points beside one
    /// with some.
    blocks: FxHashMap<[i32; 3], Near>,
}

/// The ranges of points in the blocks around one.
#[derive(Debug, Clone, Default)]
struct Near {
    own: [u32; 2],
    around: Vec<[u32; 2]>,
}

impl Undecided {
    pub(super) fn new(radius: f32, min_neighbours: u8) -> Self {
        Self {
            radius_squared: radius * radius,
            enough: min_neighbours,
            points: Vec::new(),
            blocks: FxHashMap::default(),
        }
    }

    pub(super) fn push(&mut self, point: [f32; 3]) {
        self.points.push(Waiting { point, found: 0 });
    }

    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Sorts the batch by blocks, to be searched.
    pub(super) fn arrange(&mut self, counts: &Counts) {
        self.points.sort_unstable_by_key(|waiting| split(counts.cube(waiting.point)).0);
        self.blocks.clear();
        let mut begin = 0;
        let mut own = Vec::new();
        for run in self.points.chunk_by(|a, b| split(counts.cube(a.point)).0 == split(counts.cube(b.point)).0)
        {
            let block = run.first().map_or([0; 3], |first| split(counts.cube(first.point)).0);
            let end = begin + run.len() as u32;
            own.push((block, [begin, end]));
            begin = end;
        }
        for (block, range) in own {
            for near in neighbourhood() {
                let at = std::array::from_fn(|axis| block[axis] + near[axis]);
                let entry = self.blocks.entry(at).or_default();
                if near == [0; 3] {
                    entry.own = range;
                } else {
                    entry.around.push(range);
                }
            }
        }
    }

    /// Counts a point of the cloud for all that wait within the radius.
    pub(super) fn see(&mut self, counts: &Counts, point: [f32; 3]) {
        let (block, _) = split(counts.cube(point));
        let Some(near) = self.blocks.get(&block) else { return };
        for [from, to] in near.around.iter().chain([&near.own]) {
            for waiting in &mut self.points[*from as usize..*to as usize] {
                let apart: f32 = waiting.point.iter().zip(point).map(|(a, b)| (a - b) * (a - b)).sum();
                waiting.found = waiting.found.saturating_add(u8::from(apart <= self.radius_squared));
            }
        }
    }

    /// Empties the batch; says of each point whether it is an inlier.
    pub(super) fn settle(&mut self, mut take: impl FnMut([f32; 3], bool)) {
        let enough = self.enough;
        self.points.drain(..).for_each(|waiting| take(waiting.point, waiting.found > enough));
        self.blocks.clear();
    }
}
