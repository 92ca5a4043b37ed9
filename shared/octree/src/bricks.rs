//! Where the voxels are kept. The rest of the crate knows only this module's functions, so that another layout
//! (palettes, uniform tiles, shared memory) can take its place.

use rustc_hash::FxHashMap;

use crate::morton::BRICK_BITS;

/// Voxels of a brick.
pub(crate) const BRICK_VOXELS: usize = 1 << BRICK_BITS;

/// Bricks that are allocated together: large enough that the system hands out zeroed pages.
const CHUNK: usize = 64;

/// One bit per voxel of a brick, in Morton order.
pub(crate) type Mask = [u64; BRICK_VOXELS / 64];

/// The voxels of 8 x 8 x 8, in Morton order.
pub(crate) struct Brick<'a> {
    /// Zero where `known` lacks the bit.
    pub(crate) log_odds: &'a [f32; BRICK_VOXELS],
    pub(crate) known: &'a Mask,
    pub(crate) ground: &'a Mask,
}

/// The same, to be written.
pub(crate) struct BrickMut<'a> {
    pub(crate) log_odds: &'a mut [f32; BRICK_VOXELS],
    pub(crate) known: &'a mut Mask,
    pub(crate) ground: &'a mut Mask,
}

/// Bricks by code (a voxel's Morton code without its last 9 bits).
#[derive(Debug)]
pub(crate) struct Bricks {
    directory: FxHashMap<u64, u32>,
    chunks: Vec<Chunk>,
    max: u32,
}

#[derive(Debug)]
struct Chunk {
    log_odds: Vec<[f32; BRICK_VOXELS]>,
    known: Vec<Mask>,
    ground: Vec<Mask>,
}

impl Bricks {
    pub(crate) fn new(max: u32) -> Self {
        Self { directory: FxHashMap::default(), chunks: Vec::new(), max }
    }

    pub(crate) fn len(&self) -> u32 {
        self.directory.len() as u32
    }

    pub(crate) fn max(&self) -> u32 {
        self.max
    }

    /// Bytes held, the directory included.
    pub(crate) fn memory_bytes(&self) -> usize {
        let brick = size_of::<[f32; BRICK_VOXELS]>() + 2 * size_of::<Mask>();
        // The table holds a control byte beside each entry.
        let entry = size_of::<(u64, u32)>() + 1;
        self.chunks.len() * CHUNK * brick + self.directory.capacity() * entry * 8 / 7
    }

    /// Place of the brick in the store; it never moves.
    #[inline]
    pub(crate) fn find(&self, code: u64) -> Option<u32> {
        self.directory.get(&code).copied()
    }

    /// The same, with a new empty brick where there was none; `None` where the ceiling forbids it.
    pub(crate) fn find_or_add(&mut self, code: u64) -> Option<u32> {
        if let Some(place) = self.find(code) {
            return Some(place);
        }
        let place = self.len();
        if place >= self.max {
            return None;
        }
        if place as usize == self.chunks.len() * CHUNK {
            self.chunks.push(Chunk {
                log_odds: vec![[0.0; BRICK_VOXELS]; CHUNK],
                known: vec![[0; BRICK_VOXELS / 64]; CHUNK],
                ground: vec![[0; BRICK_VOXELS / 64]; CHUNK],
            });
        }
        self.directory.insert(code, place);
        Some(place)
    }

    /// The brick at a place that [`Self::find`] gave.
    #[inline]
    pub(crate) fn get(&self, place: u32) -> Brick<'_> {
        let (chunk, at) = (&self.chunks[place as usize / CHUNK], place as usize % CHUNK);
        Brick { log_odds: &chunk.log_odds[at], known: &chunk.known[at], ground: &chunk.ground[at] }
    }

    /// The brick at a place that [`Self::find_or_add`] gave.
    #[inline]
    pub(crate) fn get_mut(&mut self, place: u32) -> BrickMut<'_> {
        let (chunk, at) = (&mut self.chunks[place as usize / CHUNK], place as usize % CHUNK);
        BrickMut {
            log_odds: &mut chunk.log_odds[at],
            known: &mut chunk.known[at],
            ground: &mut chunk.ground[at],
        }
    }

    /// Codes and places of all bricks in Morton order.
    pub(crate) fn sorted(&self) -> Vec<(u64, u32)> {
        let mut all: Vec<_> = self.directory.iter().map(|(&code, &place)| (code, place)).collect();
        all.sort_unstable();
        all
    }
}

/// Whether a mask has the bit of a voxel.
#[inline]
pub(crate) fn has(mask: &Mask, voxel: usize) -> bool {
    mask[voxel / 64] >> (voxel % 64) & 1 != 0
}

/// Sets the bit of a voxel and says whether it was clear.
#[inline]
pub(crate) fn set(mask: &mut Mask, voxel: usize) -> bool {
    let bit = 1u64 << (voxel % 64);
    let was_clear = mask[voxel / 64] & bit == 0;
    mask[voxel / 64] |= bit;
    was_clear
}

/// The set bits of a mask, ascending.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bits {
    mask: Mask,
    word: usize,
}

impl Bits {
    pub(crate) fn of(mask: Mask) -> Self {
        Self { mask, word: 0 }
    }
}

impl Iterator for Bits {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        while let Some(word) = self.mask.get_mut(self.word) {
            if *word != 0 {
                let bit = word.trailing_zeros() as usize;
                *word &= *word - 1;
                return Some(self.word * 64 + bit);
            }
            self.word += 1;
        }
        None
    }
}
