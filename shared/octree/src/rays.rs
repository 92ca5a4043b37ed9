//! Many rays from one origin into the marks of a scan, many side by side.
//!
//! A ray's walk is a chain of dependent additions and comparisons; sixteen of them at once ([`crate::lanes`]) keep the
//! processor busy. What makes this possible is that a walk that OctoMap would end in the
//! voxel of its end point takes exactly as many steps as the keys differ by in sum. So the number of steps is known
//! before, no step has to ask whether it is the last, and afterwards it is checked that the walk has arrived. The rare
//! ray that rounding has carried past its end is walked again, voxel by voxel, with OctoMap's own rule for stopping.

use crate::lanes::{self, LANES, Lanes};
use crate::marks::{NONE, ScanMarks};
use crate::mask::Mask;
use crate::morton;
use crate::trace::trace;
use crate::window::Window;
use crate::{Key, KeySpace};

/// Rays that are sorted by length together: neighbours in the scan, so that they mark the same bricks.
const BATCH: usize = 256;

/// Longer walks are done one by one.
const MAX_STEPS: u32 = 4096;

/// A ray whose end has a key.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ray {
    /// Where it ends, metres in the map frame.
    pub(crate) end: [f32; 3],
    /// The voxel that holds the end.
    pub(crate) key: Key,
    /// Whether the end says something about its voxel.
    pub(crate) ends: bool,
}

impl Ray {
    /// Steps from the origin's voxel to that of the end.
    #[inline]
    pub(crate) fn steps(&self, origin: Key) -> u32 {
        (0..3).map(|axis| u32::from(self.key[axis].abs_diff(origin[axis]))).sum()
    }
}

/// Casts rays and keeps the memory that this needs.
#[derive(Debug)]
pub(crate) struct Caster {
    /// Steps and index of the rays of a batch.
    order: Vec<(u32, u32)>,
    buffers: Buffers,
}

#[derive(Debug)]
struct Buffers {
    /// Codes of the voxels that the walks of a group have passed, step by step.
    passed: Vec<[u64; LANES]>,
    /// The same of the last steps, when the shortest walk has arrived, walk by walk.
    tails: Vec<u64>,
}

/// What all rays of a scan share.
#[derive(Debug)]
pub(crate) struct Origin {
    pub(crate) space: KeySpace,
    pub(crate) point: [f32; 3],
    key: Key,
    window: Window,
    pub(crate) codes: [u64; 3],
    pub(crate) masks: [u64; 3],
    /// By axis: what a step back, and forward, adds to the code.
    pub(crate) steps: [[u64; 2]; 3],
    /// By axis: distance from the origin to the voxel's border behind, and ahead.
    pub(crate) borders: [[f64; 2]; 3],
}

impl Default for Caster {
    fn default() -> Self {
        let buffers = Buffers {
            passed: vec![[0; LANES]; MAX_STEPS as usize],
            tails: Vec::with_capacity(LANES * MAX_STEPS as usize),
        };
        Self { order: Vec::with_capacity(BATCH), buffers }
    }
}

impl Caster {
    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.order.capacity() * size_of::<(u32, u32)>()
            + self.buffers.passed.capacity() * size_of::<[u64; LANES]>()
            + self.buffers.tails.capacity() * size_of::<u64>()
    }

    /// Marks the voxels that the rays pass through, without those of their ends.
    pub(crate) fn cast(&mut self, from: &Origin, rays: &[Ray], marks: &mut ScanMarks) {
        for batch in rays.chunks(BATCH) {
            self.order.clear();
            for (n, ray) in batch.iter().enumerate() {
                let steps = ray.steps(from.key);
                if steps > MAX_STEPS || !from.window.is_dense() {
                    from.walk(ray, marks);
                } else if steps > 0 {
                    self.order.push((steps, n as u32));
                }
            }
            self.order.sort_unstable();
            let (groups, rest) = self.order.as_chunks::<LANES>();
            for group in groups {
                from.cast_group(group, batch, &mut self.buffers, marks);
            }
            if let Some(&last) = rest.last() {
                let mut group = [last; LANES];
                group[..rest.len()].copy_from_slice(rest);
                group.sort_unstable();
                from.cast_group(&group, batch, &mut self.buffers, marks);
            }
        }
    }
}

/// What a further thread needs.
#[derive(Debug)]
pub(crate) struct Helper {
    caster: Caster,
    marks: ScanMarks,
    /// Its slots by those of the calling thread, [`NONE`] where it has none.
    slots: Vec<u32>,
}

impl Helper {
    pub(crate) fn new(max_bytes: usize) -> Self {
        Self { caster: Caster::default(), marks: ScanMarks::new(max_bytes), slots: Vec::new() }
    }

    pub(crate) fn cast(&mut self, from: &Origin, rays: &[Ray]) {
        self.marks.start(from.window);
        self.caster.cast(from, rays, &mut self.marks);
    }

    /// Forgets the last scan.
    pub(crate) fn clear(&mut self) {
        self.marks.clear();
        self.slots.clear();
    }

    /// Says which of its slots belong to those of the calling thread.
    pub(crate) fn join(&mut self, marks: &mut ScanMarks, bounds: Option<(Key, Key)>) {
        if let Some((min, max)) = bounds {
            self.marks.limit(min, max);
        }
        marks.join(&self.marks, &mut self.slots);
    }

    /// The free voxels of a slot of the calling thread's marks.
    #[inline]
    pub(crate) fn free(&self, slot: u32) -> Option<&Mask> {
        let own = self.slots.get(slot as usize).copied().filter(|&own| own != NONE)?;
        Some(self.marks.free(own))
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.caster.memory_bytes() + self.marks.memory_bytes() + self.slots.capacity() * 4
    }
}

impl Origin {
    /// The `point` in the voxel `key`, for rays that stay within a window.
    pub(crate) fn new(space: &KeySpace, point: [f32; 3], key: Key, window: &Window) -> Self {
        Self {
            space: *space,
            point,
            key,
            window: *window,
            codes: [0, 1, 2].map(|axis| window.axis_code(key, axis)),
            masks: window.masks(),
            steps: [0, 1, 2].map(|axis| [window.step(axis, false), window.step(axis, true)]),
            borders: [0, 1, 2].map(|axis| {
                [-1.0, 1.0].map(|sign: f64| {
                    // OctoMap rounds half a voxel to f32 here.
                    let half = f64::from((sign * space.resolution() * 0.5) as f32);
                    space.axis_centre(key[axis]) + half - f64::from(point[axis])
                })
            }),
        }
    }

    fn cast_group(
        &self,
        group: &[(u32, u32); LANES],
        batch: &[Ray],
        buffers: &mut Buffers,
        marks: &mut ScanMarks,
    ) {
        let rays = group.map(|(_, index)| &batch[index as usize]);
        // The walks are sorted by length: so many steps do not carry the shortest to its end.
        let common = group[0].0 as usize - 1;
        let passed = &mut buffers.passed[..common];
        let (lanes, lengths) = lanes::march(self, &rays.map(|ray| ray.end), passed);
        buffers.tails.clear();
        let mut arrived = [true; LANES];
        for lane in 0..LANES {
            let from = buffers.tails.len();
            buffers.tails.resize(from + group[lane].0 as usize - common, 0);
            let tail = &mut buffers.tails[from..];
            arrived[lane] = self.finish(&lanes, lane, rays[lane], f64::from(lengths[lane]), common > 0, tail);
            if !arrived[lane] {
                buffers.tails.truncate(from);
                self.walk(rays[lane], marks);
            }
        }
        if arrived == [true; LANES] {
            marks.mark_all_free(passed.as_flattened());
        } else {
            for lane in (0..LANES).filter(|&lane| arrived[lane]) {
                passed.iter().for_each(|codes| marks.mark_free(codes[lane]));
            }
        }
        marks.mark_all_free(&buffers.tails);
    }

    /// Takes one walk to its end, noting the voxels before; `false` where OctoMap's would have stopped elsewhere.
    #[inline]
    fn finish(
        &self,
        lanes: &Lanes,
        lane: usize,
        ray: &Ray,
        length: f64,
        moved: bool,
        tail: &mut [u64],
    ) -> bool {
        let mut crossing = lanes.crossing.map(|axis| axis[lane]);
        let mut codes = lanes.code.map(|axis| axis[lane]);
        let spacing = lanes.spacing.map(|axis| axis[lane]);
        let steps = lanes.step.map(|axis| axis[lane]);
        let mut within = true;
        let moved = moved || tail.len() > 1;
        for place in tail.iter_mut() {
            *place = codes[0] | codes[1] | codes[2];
            let [x, y, z] = crossing;
            within = x.min(y).min(z) <= length;
            let axis = if x < y {
                if x < z { 0 } else { 2 }
            } else if y < z {
                1
            } else {
                2
            };
            codes[axis] = codes[axis].wrapping_add(steps[axis]) & self.masks[axis];
            crossing[axis] += spacing[axis];
        }
        // `within` is that of the last voxel before the end; the first voxel of all is passed in any case.
        let arrived = (0..3).all(|axis| codes[axis] == self.window.axis_code(ray.key, axis));
        arrived && (within || !moved)
    }

    /// One ray, voxel by voxel.
    #[cold]
    fn walk(&self, ray: &Ray, marks: &mut ScanMarks) {
        let window = self.window;
        trace(&self.space, self.point, ray.end, |code| marks.mark_free(window.code(morton::decode(code))));
    }
}
