//! Points that counts alone do not settle: they wait with their places until the cloud was read once more.

use rustc_hash::FxHashMap;

use super::counts::{Counts, REACH, SIDE, split};

/// A point and how many within its radius were found so far; itself is among them, as the cloud is read whole.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    block: [i32; 3],
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
    /// Where the points of a block begin and end, after [`Self::arrange`].
    blocks: FxHashMap<[i32; 3], [u32; 2]>,
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

    pub(super) fn push(&mut self, counts: &Counts, point: [f32; 3]) {
        let (block, _) = split(counts.cube(point));
        self.points.push(Waiting { block, point, found: 0 });
    }

    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Sorts the batch by blocks, to be searched.
    pub(super) fn arrange(&mut self) {
        self.points.sort_unstable_by_key(|waiting| waiting.block);
        let mut begin = 0;
        for run in self.points.chunk_by(|a, b| a.block == b.block) {
            let end = begin + run.len() as u32;
            self.blocks.extend(run.first().map(|first| (first.block, [begin, end])));
            begin = end;
        }
    }

    /// Counts a point of the cloud for all that wait within the radius.
    pub(super) fn see(&mut self, counts: &Counts, point: [f32; 3]) {
        let cube = counts.cube(point);
        let low = cube.map(|axis| axis.saturating_sub(REACH).div_euclid(SIDE));
        let high = cube.map(|axis| axis.saturating_add(REACH).div_euclid(SIDE));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let Some([from, to]) = self.blocks.get(&[x, y, z]) else { continue };
                    for waiting in &mut self.points[*from as usize..*to as usize] {
                        let [dx, dy, dz] = std::array::from_fn(|axis| waiting.point[axis] - point[axis]);
                        let near = dx * dx + dy * dy + dz * dz <= self.radius_squared;
                        waiting.found = waiting.found.saturating_add(u8::from(near));
                    }
                }
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
