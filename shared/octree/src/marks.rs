//! Which voxels one scan touches: bit masks per brick in place of sets of keys. Everything is kept for the next scan, so
//! that a scan like the ones before it allocates nothing.

use crate::Key;
use crate::mask::{self, Mask, WORDS};
use crate::morton::{self, BRICK_BITS};
use crate::window::Window;

const VOXEL: u64 = (1 << BRICK_BITS) - 1;
/// No slot, or no ends.
pub(crate) const NONE: u32 = 0;

/// The slot that takes the marks of bricks that are refused.
const WASTE: u32 = 1;

/// What is known of a marked brick besides its free voxels.
#[derive(Clone, Copy, Debug)]
struct Info {
    /// The brick's number in the window.
    number: u64,
    /// Index of its ends, or [`NONE`].
    ends: u32,
    /// Where the table points here.
    entry: u32,
}

/// The ends of rays in a brick.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ends {
    pub(crate) hit: Mask,
    pub(crate) ground: Mask,
}

impl Ends {
    pub(crate) fn is_empty(&self) -> bool {
        mask::is_empty(&self.hit) && mask::is_empty(&self.ground)
    }
}

/// What one scan says about a brick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BrickMarks<'a> {
    /// Passed by a ray, or the end of a ground ray.
    pub(crate) free: &'a Mask,
    pub(crate) ends: Option<&'a Ends>,
}

/// The marks of one scan.
#[derive(Debug)]
pub(crate) struct ScanMarks {
    window: Window,
    dense: bool,
    /// Slot of each brick by its number in a dense window, otherwise by its hash (open addressing, a power of two long,
    /// at most half full).
    table: Vec<u32>,
    /// Passed by a ray, or the end of a ground ray; after the update the voxels that changed. By slot.
    free: Vec<Mask>,
    infos: Vec<Info>,
    used: usize,
    ends: Vec<Ends>,
    used_ends: usize,
    max: usize,
    /// Times that a brick was refused because the scan touches more than `max`.
    pub(crate) refused: u32,
}

impl ScanMarks {
    /// Marks for a map of at most so many bytes: those of one scan may take as many, and in a small map 8 MiB.
    pub(crate) fn new(max_bytes: usize) -> Self {
        let waste = Info { number: u64::MAX, ends: NONE, entry: 0 };
        Self {
            window: Window::default(),
            dense: true,
            table: Vec::new(),
            free: vec![[0; WORDS]; 2],
            infos: vec![waste; 2],
            used: 2,
            ends: vec![Ends::default()],
            used_ends: 1,
            max: (max_bytes / 128).clamp(1 << 16, 1 << 28),
            refused: 0,
        }
    }

    /// Forgets the last scan and takes one that stays within a window.
    pub(crate) fn start(&mut self, window: Window) {
        self.clear();
        self.window = window;
        self.dense = window.is_dense();
        let length = if self.dense { window.bricks() } else { 1 << 16 };
        if self.table.len() < length {
            // Fresh zeroed memory costs nothing until it is touched.
            self.table = vec![NONE; length];
        }
    }

    /// Forgets the last scan.
    pub(crate) fn clear(&mut self) {
        for info in &self.infos[2..self.used] {
            self.table[info.entry as usize] = NONE;
        }
        self.used = 2;
        self.used_ends = 1;
        self.refused = 0;
    }

    pub(crate) fn window(&self) -> &Window {
        &self.window
    }

    /// A ray passes through the voxel.
    #[inline]
    pub(crate) fn mark_free(&mut self, code: u64) {
        let slot = self.slot(code >> BRICK_BITS);
        self.free[slot as usize][(code >> 6) as usize % WORDS] |= 1 << (code % 64);
    }

    /// Rays pass through the voxels. Neighbours in the list are often in one word, and writing it again and again would
    /// wait for itself; so the list is gone through at four places at once.
    pub(crate) fn mark_all_free(&mut self, codes: &[u64]) {
        let quarter = codes.len() / 4;
        let (a, rest) = codes.split_at(quarter);
        let (b, rest) = rest.split_at(quarter);
        let (c, rest) = rest.split_at(quarter);
        let (d, rest) = rest.split_at(quarter);
        let mut done = 0;
        while done < quarter {
            done += self.mark_present([&a[done..], &b[done..], &c[done..], &d[done..]]);
            if done < quarter {
                [a, b, c, d].iter().for_each(|codes| self.mark_free(codes[done]));
                done += 1;
            }
        }
        rest.iter().for_each(|&code| self.mark_free(code));
    }

    /// Marks voxels of four lists up to the first whose brick has no slot yet; gives how many of each.
    #[inline]
    fn mark_present(&mut self, [a, b, c, d]: [&[u64]; 4]) -> usize {
        if !self.dense {
            return 0;
        }
        let (table, free) = (&self.table[..], self.free.as_flattened_mut());
        for (n, (((&a, &b), &c), &d)) in a.iter().zip(b).zip(c).zip(d).enumerate() {
            let codes = [a, b, c, d];
            let slots = codes.map(|code| table[(code >> BRICK_BITS) as usize]);
            if slots.contains(&NONE) {
                return n;
            }
            for (slot, code) in slots.into_iter().zip(codes) {
                free[slot as usize * WORDS + (code >> 6) as usize % WORDS] |= 1 << (code % 64);
            }
        }
        a.len()
    }

    /// All rays pass through the block of 4 x 4 x 4 voxels, unless one ends in it.
    pub(crate) fn mark_block(&mut self, key: Key) {
        let code = self.window.code(key);
        let (slot, word) = (self.slot(code >> BRICK_BITS), (code >> 6) as usize % WORDS);
        if self.ends(slot).is_none_or(|ends| ends.hit[word] == 0) {
            self.free[slot as usize][word] = u64::MAX;
        }
    }

    /// A ray ends in the voxel; says whether it is the first.
    pub(crate) fn mark_hit(&mut self, code: u64) -> bool {
        mask::set(&mut self.ends_at(code).hit, (code & VOXEL) as usize)
    }

    /// A ground ray ends in the voxel; says whether it is the first.
    pub(crate) fn mark_ground(&mut self, code: u64) -> bool {
        self.mark_free(code);
        mask::set(&mut self.ends_at(code).ground, (code & VOXEL) as usize)
    }

    fn ends_at(&mut self, code: u64) -> &mut Ends {
        let slot = self.slot(code >> BRICK_BITS);
        self.ends_of(slot)
    }

    fn ends_of(&mut self, slot: u32) -> &mut Ends {
        let info = &mut self.infos[slot as usize];
        if info.ends == NONE {
            info.ends = self.used_ends as u32;
            self.used_ends += 1;
            match self.ends.get_mut(info.ends as usize) {
                Some(ends) => *ends = Ends::default(),
                None => self.ends.push(Ends::default()),
            }
        }
        &mut self.ends[info.ends as usize]
    }

    /// The slot of a brick.
    #[inline]
    fn slot(&mut self, number: u64) -> u32 {
        if self.dense {
            match self.table[number as usize] {
                NONE => self.add(number, number as usize),
                slot => slot,
            }
        } else {
            self.hashed(number)
        }
    }

    fn hashed(&mut self, number: u64) -> u32 {
        let mut entry = home(number, self.table.len());
        loop {
            match self.table[entry] {
                NONE => return self.add(number, entry),
                slot if self.infos[slot as usize].number == number => return slot,
                _ => entry = (entry + 1) & (self.table.len() - 1),
            }
        }
    }

    #[cold]
    fn add(&mut self, number: u64, entry: usize) -> u32 {
        if self.used - 2 >= self.max {
            self.refused = self.refused.saturating_add(1);
            return WASTE;
        }
        let slot = self.used as u32;
        let info = Info { number, ends: NONE, entry: entry as u32 };
        match self.free.get_mut(self.used) {
            Some(free) => {
                *free = [0; WORDS];
                self.infos[self.used] = info;
            }
            None => {
                self.free.push([0; WORDS]);
                self.infos.push(info);
            }
        }
        self.table[entry] = slot;
        self.used += 1;
        if !self.dense && self.used * 2 > self.table.len() {
            self.grow();
        }
        slot
    }

    fn grow(&mut self) {
        let length = self.table.len() * 2;
        self.table.clear();
        self.table.resize(length, NONE);
        for (slot, info) in self.infos[..self.used].iter_mut().enumerate().skip(2) {
            let mut entry = home(info.number, length);
            while self.table[entry] != NONE {
                entry = (entry + 1) & (length - 1);
            }
            self.table[entry] = slot as u32;
            info.entry = entry as u32;
        }
    }

    /// Makes room for what another thread has marked in the same window; gives its slot for each of ours, [`NONE`] where
    /// it has marked nothing.
    pub(crate) fn join(&mut self, other: &Self, theirs: &mut Vec<u32>) {
        theirs.clear();
        for slot in 2..other.used {
            let own = self.slot(other.infos[slot].number) as usize;
            if own >= theirs.len() {
                theirs.resize(self.used.max(own + 1), NONE);
            }
            theirs[own] = slot as u32;
        }
        self.refused = self.refused.saturating_add(other.refused);
    }

    /// Takes back all marks outside a box of keys, both inclusive; a brick without any is as if it had not been marked.
    pub(crate) fn limit(&mut self, min: Key, max: Key) {
        for slot in 2..self.used {
            let corner = morton::decode(self.window.brick_code(self.infos[slot].number) << BRICK_BITS);
            let inside = mask::inside(corner, min, max);
            for (word, inside) in self.free[slot].iter_mut().zip(inside) {
                *word &= inside;
            }
            let ends = self.infos[slot].ends;
            if ends != NONE {
                let ends = &mut self.ends[ends as usize];
                for mask in [&mut ends.hit, &mut ends.ground] {
                    mask.iter_mut().zip(inside).for_each(|(word, inside)| *word &= inside);
                }
            }
        }
    }

    /// The free voxels of a slot.
    #[inline]
    pub(crate) fn free(&self, slot: u32) -> &Mask {
        &self.free[slot as usize]
    }

    /// The ends of rays in a slot's brick.
    #[inline]
    pub(crate) fn ends(&self, slot: u32) -> Option<&Ends> {
        match self.infos[slot as usize].ends {
            NONE => None,
            index => self.ends.get(index as usize),
        }
    }

    /// All slots with the Morton codes of their bricks.
    pub(crate) fn bricks(&self) -> impl Iterator<Item = (u32, u64)> {
        let infos = self.infos[..self.used].iter().enumerate().skip(2);
        infos.map(|(slot, info)| (slot as u32, self.window.brick_code(info.number)))
    }

    /// Bytes that are kept from scan to scan.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.table.capacity() * 4
            + self.free.capacity() * size_of::<Mask>()
            + self.infos.capacity() * size_of::<Info>()
            + self.ends.capacity() * size_of::<Ends>()
    }
}

/// First entry to look at: the high bits of a Fibonacci hash.
#[inline]
fn home(number: u64, length: usize) -> usize {
    let hash = number.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (hash >> (64 - length.trailing_zeros())) as usize
}
