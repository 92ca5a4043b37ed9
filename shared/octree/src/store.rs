//! The voxels of bricks, each brick in the smallest of six forms that holds it exactly.

use crate::SensorModel;
use crate::arena::Arena;
use crate::marks::{BrickMarks, Ends};
use crate::mask::{self, BRICK_VOXELS, Mask, WORDS};
use crate::palette::{Palette, State, UNKNOWN, Update};
use crate::planes::{self, Overflow};

/// A brick of P bit planes: 64 P bytes.
type Planes<const P: usize> = [[u64; P]; WORDS];

/// NaN where unknown.
type Floats = [f32; BRICK_VOXELS];

/// Where a brick's voxels are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// All 512 have this state (as OctoMap prunes them to one leaf): no memory of their own.
    Uniform(State),
    Planes2(u32),
    /// Two blocks of two planes each, so that a brick that outgrows two planes leaves no gap behind.
    Planes4([u32; 2]),
    Planes8(u32),
    Planes16(u32),
    /// The last resort where the palette is full.
    Floats(u32),
}

/// No ground flag in the brick.
const NO_GROUND: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
struct Slot {
    form: Form,
    /// Index of the ground flags or [`NO_GROUND`].
    ground: u32,
    /// Number of the last scan that marked the brick.
    seen: u32,
    /// Number of the last change in it.
    revision: u32,
}

/// What a scan did to a brick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Sums {
    pub(crate) free: u32,
    pub(crate) occupied: u32,
    /// Voxels that were unknown.
    pub(crate) new: u32,
    /// Voxels that were unknown and without a flag.
    pub(crate) listed: u32,
    pub(crate) changed: u32,
}

impl std::ops::AddAssign for Sums {
    fn add_assign(&mut self, other: Self) {
        self.free += other.free;
        self.occupied += other.occupied;
        self.new += other.new;
        self.listed += other.listed;
        self.changed += other.changed;
    }
}

/// Bricks by index, with the palette that their states belong to. A map has several, so that threads can update one
/// each.
#[derive(Clone, Debug)]
pub(crate) struct Store {
    palette: Palette,
    slots: Vec<Slot>,
    /// Slots without a brick.
    free: Vec<u32>,
    planes2: Arena<Planes<2>>,
    planes8: Arena<Planes<8>>,
    planes16: Arena<Planes<16>>,
    floats: Arena<Floats>,
    ground: Arena<Mask>,
}

impl Store {
    pub(crate) fn new(sensor: SensorModel) -> Self {
        Self {
            palette: Palette::new(sensor),
            slots: Vec::new(),
            free: Vec::new(),
            planes2: Arena::default(),
            planes8: Arena::default(),
            planes16: Arena::default(),
            floats: Arena::default(),
            ground: Arena::default(),
        }
    }

    /// Index of a new brick of which nothing is known.
    pub(crate) fn add(&mut self) -> u32 {
        let slot = Slot { form: Form::Uniform(UNKNOWN), ground: NO_GROUND, seen: 0, revision: 0 };
        if let Some(index) = self.free.pop() {
            self.slots[index as usize] = slot;
            return index;
        }
        self.slots.push(slot);
        self.slots.len() as u32 - 1
    }

    /// Forgets a brick and gives its memory back.
    pub(crate) fn remove(&mut self, index: u32) {
        self.release(self.slots[index as usize].form);
        let ground = std::mem::replace(&mut self.slots[index as usize].ground, NO_GROUND);
        if ground != NO_GROUND {
            self.ground.remove(ground);
        }
        self.slots[index as usize].form = Form::Uniform(UNKNOWN);
        self.free.push(index);
    }

    /// Number of the last scan that marked the brick, and of its last change.
    #[inline]
    pub(crate) fn stamps(&self, index: u32) -> (u32, u32) {
        let slot = &self.slots[index as usize];
        (slot.seen, slot.revision)
    }

    pub(crate) fn set_revision(&mut self, index: u32, revision: u32) {
        self.slots[index as usize].revision = revision;
    }

    /// Log-odds of a voxel; `None` where it is unknown.
    #[inline]
    pub(crate) fn value(&self, index: u32, voxel: usize) -> Option<f32> {
        let (word, bit) = (voxel / 64, (voxel % 64) as u32);
        let state = match self.slots[index as usize].form {
            Form::Uniform(state) => state,
            Form::Planes2(at) => planes::get(&self.planes2.get(at)[word], bit),
            Form::Planes4(at) => planes::get(&word4(self.planes2.get(at[0]), self.planes2.get(at[1]), word), bit),
            Form::Planes8(at) => planes::get(&self.planes8.get(at)[word], bit),
            Form::Planes16(at) => planes::get(&self.planes16.get(at)[word], bit),
            Form::Floats(at) => {
                let value = self.floats.get(at)[voxel];
                return (!value.is_nan()).then_some(value);
            }
        };
        (state != UNKNOWN).then(|| self.palette.value(state))
    }

    /// The value that all 512 voxels have, where they are known and have one.
    #[inline]
    pub(crate) fn uniform(&self, index: u32) -> Option<f32> {
        match self.slots[index as usize].form {
            Form::Uniform(state) if state != UNKNOWN => Some(self.palette.value(state)),
            _ => None,
        }
    }

    /// The voxels with a value.
    pub(crate) fn known(&self, index: u32) -> Mask {
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => [0; WORDS],
            Form::Uniform(_) => [u64::MAX; WORDS],
            Form::Planes2(at) => self.planes2.get(at).map(|word| planes::known(&word)),
            Form::Planes4(at) => get4(&self.planes2, at).map(|word| planes::known(&word)),
            Form::Planes8(at) => self.planes8.get(at).map(|word| planes::known(&word)),
            Form::Planes16(at) => self.planes16.get(at).map(|word| planes::known(&word)),
            Form::Floats(at) => {
                let values = self.floats.get(at);
                std::array::from_fn(|word| {
                    (0..64).fold(0, |bits, bit| bits | u64::from(!values[word * 64 + bit].is_nan()) << bit)
                })
            }
        }
    }

    /// Calls `visit` with each value of a brick and the voxels that have it: word by word, a group of equal voxels at a
    /// time.
    #[inline]
    pub(crate) fn for_each_value(&self, index: u32, mut visit: impl FnMut(usize, u64, f32)) {
        fn groups<const P: usize>(
            words: &Planes<P>,
            palette: &Palette,
            visit: &mut impl FnMut(usize, u64, f32),
        ) {
            for (word, planes) in words.iter().enumerate() {
                let mut left = planes::known(planes);
                while left != 0 {
                    let (same, state) = planes::alike(planes, left, left.trailing_zeros());
                    left &= !same;
                    visit(word, same, palette.value(state));
                }
            }
        }
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => {}
            Form::Uniform(state) => {
                (0..WORDS).for_each(|word| visit(word, u64::MAX, self.palette.value(state)));
            }
            Form::Planes2(at) => groups(self.planes2.get(at), &self.palette, &mut visit),
            Form::Planes4(at) => groups(&get4(&self.planes2, at), &self.palette, &mut visit),
            Form::Planes8(at) => groups(self.planes8.get(at), &self.palette, &mut visit),
            Form::Planes16(at) => groups(self.planes16.get(at), &self.palette, &mut visit),
            Form::Floats(at) => {
                for (voxel, value) in self.floats.get(at).iter().enumerate().filter(|(_, v)| !v.is_nan()) {
                    visit(voxel / 64, 1 << (voxel % 64), *value);
                }
            }
        }
    }

    /// The voxels with a ground flag.
    #[inline]
    pub(crate) fn ground(&self, index: u32) -> Mask {
        match self.slots[index as usize].ground {
            NO_GROUND => [0; WORDS],
            at => *self.ground.get(at),
        }
    }

    /// Gives voxels the ground flag, besides those that have it.
    pub(crate) fn add_ground(&mut self, index: u32, flags: &Mask) {
        let slot = &mut self.slots[index as usize];
        if slot.ground == NO_GROUND {
            slot.ground = self.ground.add(*flags);
            return;
        }
        for (word, more) in self.ground.get_mut(slot.ground).iter_mut().zip(flags) {
            *word |= more;
        }
    }

    /// Takes the ground flag from voxels.
    fn remove_ground(&mut self, index: u32, flags: &Mask) {
        let slot = &mut self.slots[index as usize];
        if slot.ground == NO_GROUND {
            return;
        }
        let ground = self.ground.get_mut(slot.ground);
        for (word, less) in ground.iter_mut().zip(flags) {
            *word &= !less;
        }
        if *ground == [0; WORDS] {
            self.ground.remove(std::mem::replace(&mut slot.ground, NO_GROUND));
        }
    }

    /// Gives the voxels of `mask` one value.
    pub(crate) fn assign(&mut self, index: u32, mask: &Mask, value: f32) {
        match self.palette.state(value) {
            Some(state) => self.put(index, mask, state),
            None => {
                let at = self.make_floats(index);
                let floats = self.floats.get_mut(at);
                mask::Bits::of(*mask).for_each(|voxel| floats[voxel] = value);
            }
        }
    }

    /// Forgets value and flag of the voxels of `mask`.
    pub(crate) fn erase(&mut self, index: u32, mask: &Mask) {
        self.remove_ground(index, mask);
        self.put(index, mask, UNKNOWN);
    }

    fn put(&mut self, index: u32, mask: &Mask, state: State) {
        if *mask == [u64::MAX; WORDS] {
            self.release(self.slots[index as usize].form);
            self.slots[index as usize].form = Form::Uniform(state);
            return;
        }
        if self.slots[index as usize].form == Form::Uniform(state) {
            return;
        }
        self.make_room(index, state);
        fn all<const P: usize>(words: &mut Planes<P>, mask: &Mask, state: State) {
            words.iter_mut().zip(mask).for_each(|(word, mask)| planes::put(word, *mask, state));
        }
        match self.slots[index as usize].form {
            Form::Uniform(_) => {}
            Form::Planes2(at) => all(self.planes2.get_mut(at), mask, state),
            Form::Planes4(at) => {
                let mut words = get4(&self.planes2, at);
                all(&mut words, mask, state);
                set4(&mut self.planes2, at, &words);
            }
            Form::Planes8(at) => all(self.planes8.get_mut(at), mask, state),
            Form::Planes16(at) => all(self.planes16.get_mut(at), mask, state),
            Form::Floats(at) => {
                let value = if state == UNKNOWN { f32::NAN } else { self.palette.value(state) };
                let floats = self.floats.get_mut(at);
                mask::Bits::of(*mask).for_each(|voxel| floats[voxel] = value);
            }
        }
        self.collapse(index);
    }

    /// Updates each marked voxel once, and says which have a new value or flag. A voxel with a hit in it is not cleared by
    /// the rays that pass it. `stamps` are the numbers of the scan and of the change.
    pub(crate) fn update(
        &mut self,
        index: u32,
        marks: BrickMarks<'_>,
        changed: &mut Mask,
        (scan, revision): (u32, u32),
    ) -> Sums {
        self.slots[index as usize].seen = scan;
        let old_ground = self.ground(index);
        let mut sums = Sums::default();
        let mut new = [0; WORDS];
        if let Some(Ends { hit, ground }) = marks.ends {
            let free = std::array::from_fn(|word| marks.free[word] & !hit[word]);
            sums.free = mask::count(&free) as u32;
            sums.occupied = mask::count(hit) as u32;
            let hit = (sums.occupied > 0).then_some(hit);
            *changed = self.update_values(index, &free, hit, &mut new);
            if !mask::is_empty(ground) {
                self.add_ground(index, ground);
                for word in 0..WORDS {
                    changed[word] |= ground[word] & !old_ground[word];
                }
            }
        } else {
            sums.free = mask::count(marks.free) as u32;
            *changed = self.update_values(index, marks.free, None, &mut new);
        }
        sums.changed = mask::count(changed) as u32;
        for (new, ground) in new.iter().zip(&old_ground) {
            sums.new += new.count_ones();
            sums.listed += (new & !ground).count_ones();
        }
        if sums.changed > 0 {
            self.slots[index as usize].revision = revision;
        }
        sums
    }

    /// Gives the voxels with a new value, and in `new` those that were unknown.
    fn update_values(&mut self, index: u32, free: &Mask, hit: Option<&Mask>, new: &mut Mask) -> Mask {
        if let (Form::Uniform(state), None) = (self.slots[index as usize].form, hit) {
            let next = self.palette.next(state, Update::Miss);
            if next == Some(state) {
                return [0; WORDS];
            }
            if let (Some(next), true) = (next, *free == [u64::MAX; WORDS]) {
                self.slots[index as usize].form = Form::Uniform(next);
                if state == UNKNOWN {
                    *new = *free;
                }
                return *free;
            }
        }
        let mut changed = [0; WORDS];
        let mut from = 0;
        loop {
            let none = [0; WORDS];
            let marks = (free, hit.unwrap_or(&none));
            let palette = &mut self.palette;
            let overflow = match self.slots[index as usize].form {
                Form::Uniform(state) => {
                    self.make_room(index, state.max(1));
                    continue;
                }
                Form::Planes2(at) => {
                    update_words(self.planes2.get_mut(at), marks, palette, &mut from, &mut changed, new)
                }
                Form::Planes4(at) => {
                    let mut words = get4(&self.planes2, at);
                    let done = update_words(&mut words, marks, palette, &mut from, &mut changed, new);
                    set4(&mut self.planes2, at, &words);
                    done
                }
                Form::Planes8(at) => {
                    update_words(self.planes8.get_mut(at), marks, palette, &mut from, &mut changed, new)
                }
                Form::Planes16(at) => {
                    update_words(self.planes16.get_mut(at), marks, palette, &mut from, &mut changed, new)
                }
                Form::Floats(at) => {
                    update_floats(self.floats.get_mut(at), marks, palette, from, &mut changed, new);
                    Ok(())
                }
            };
            match overflow {
                Ok(()) => break,
                Err(Overflow::State(state)) => self.make_room(index, state),
                Err(Overflow::Palette) => {
                    self.make_floats(index);
                }
            }
        }
        if changed != [0; WORDS] {
            self.collapse(index);
        }
        changed
    }

    /// Gives a brick planes enough for a state, and planes at all.
    fn make_room(&mut self, index: u32, state: State) {
        let old = self.slots[index as usize].form;
        let common = if let Form::Uniform(common) = old { common } else { 0 };
        self.slots[index as usize].form = match state.max(common) {
            0..4 => match old {
                Form::Uniform(_) => Form::Planes2(self.planes2.add(filled(common))),
                _ => return,
            },
            4..16 => match old {
                Form::Uniform(_) => {
                    let at = [self.planes2.add([[0; 2]; WORDS]), self.planes2.add([[0; 2]; WORDS])];
                    set4(&mut self.planes2, at, &filled(common));
                    Form::Planes4(at)
                }
                Form::Planes2(at) => {
                    self.slots[index as usize].form = Form::Planes4([at, self.planes2.add([[0; 2]; WORDS])]);
                    return;
                }
                _ => return,
            },
            16..256 => match old {
                Form::Uniform(_) => Form::Planes8(self.planes8.add(filled(common))),
                Form::Planes2(at) => Form::Planes8(self.planes8.add(widened(self.planes2.get(at)))),
                Form::Planes4(at) => Form::Planes8(self.planes8.add(widened(&get4(&self.planes2, at)))),
                _ => return,
            },
            256.. => match old {
                Form::Uniform(_) => Form::Planes16(self.planes16.add(filled(common))),
                Form::Planes2(at) => Form::Planes16(self.planes16.add(widened(self.planes2.get(at)))),
                Form::Planes4(at) => Form::Planes16(self.planes16.add(widened(&get4(&self.planes2, at)))),
                Form::Planes8(at) => Form::Planes16(self.planes16.add(widened(self.planes8.get(at)))),
                _ => return,
            },
        };
        self.release(old);
    }

    /// Gives a brick plain values; their index.
    fn make_floats(&mut self, index: u32) -> u32 {
        let old = self.slots[index as usize].form;
        if let Form::Floats(at) = old {
            return at;
        }
        let mut floats = [f32::NAN; BRICK_VOXELS];
        self.for_each_value(index, |word, mask, value| {
            (0..64).filter(|bit| mask >> bit & 1 != 0).for_each(|bit| floats[word * 64 + bit] = value);
        });
        let at = self.floats.add(floats);
        self.release(old);
        self.slots[index as usize].form = Form::Floats(at);
        at
    }

    /// Frees the planes of a brick whose voxels have all become equal.
    fn collapse(&mut self, index: u32) {
        fn common<const P: usize>(words: &Planes<P>) -> Option<State> {
            let state = planes::uniform(&words[0])?;
            words.iter().all(|word| *word == words[0]).then_some(state)
        }
        let form = self.slots[index as usize].form;
        let common = match form {
            Form::Uniform(_) | Form::Floats(_) => None,
            Form::Planes2(at) => common(self.planes2.get(at)),
            Form::Planes4(at) => common(&get4(&self.planes2, at)),
            Form::Planes8(at) => common(self.planes8.get(at)),
            Form::Planes16(at) => common(self.planes16.get(at)),
        };
        if let Some(state) = common {
            self.release(form);
            self.slots[index as usize].form = Form::Uniform(state);
        }
    }

    fn release(&mut self, form: Form) {
        match form {
            Form::Uniform(_) => {}
            Form::Planes2(at) => self.planes2.remove(at),
            Form::Planes4(at) => at.into_iter().for_each(|at| self.planes2.remove(at)),
            Form::Planes8(at) => self.planes8.remove(at),
            Form::Planes16(at) => self.planes16.remove(at),
            Form::Floats(at) => self.floats.remove(at),
        }
    }

    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.palette.memory_bytes()
            + self.slots.capacity() * size_of::<Slot>()
            + self.free.capacity() * 4
            + self.planes2.memory_bytes()
            + self.planes8.memory_bytes()
            + self.planes16.memory_bytes()
            + self.floats.memory_bytes()
            + self.ground.memory_bytes()
    }
}

#[inline]
fn word4(low: &Planes<2>, high: &Planes<2>, word: usize) -> [u64; 4] {
    [low[word][0], low[word][1], high[word][0], high[word][1]]
}

#[inline]
fn get4(blocks: &Arena<Planes<2>>, at: [u32; 2]) -> Planes<4> {
    let [low, high] = at.map(|at| blocks.get(at));
    std::array::from_fn(|word| word4(low, high, word))
}

#[inline]
fn set4(blocks: &mut Arena<Planes<2>>, at: [u32; 2], words: &Planes<4>) {
    for (half, at) in at.into_iter().enumerate() {
        let block = blocks.get_mut(at);
        for (word, planes) in block.iter_mut().zip(words) {
            *word = [planes[2 * half], planes[2 * half + 1]];
        }
    }
}

fn filled<const P: usize>(state: State) -> Planes<P> {
    let mut word = [0; P];
    planes::put(&mut word, u64::MAX, state);
    [word; WORDS]
}

fn widened<const P: usize, const Q: usize>(words: &Planes<P>) -> Planes<Q> {
    words.map(|word| std::array::from_fn(|plane| word.get(plane).copied().unwrap_or(0)))
}

/// Updates the words from `from` on; after an overflow it can be called again with more planes.
#[inline]
fn update_words<const P: usize>(
    words: &mut Planes<P>,
    (free, hit): (&Mask, &Mask),
    palette: &mut Palette,
    from: &mut usize,
    changed: &mut Mask,
    new: &mut Mask,
) -> Result<(), Overflow> {
    while *from < WORDS {
        let word = *from;
        if free[word] | hit[word] != 0 {
            let mut after = words[word];
            let missed = planes::update(&mut after, free[word], Update::Miss, palette)?;
            let struck = planes::update(&mut after, hit[word], Update::Hit, palette)?;
            words[word] = after;
            changed[word] = missed.changed | struck.changed;
            new[word] = missed.new | struck.new;
        }
        *from += 1;
    }
    Ok(())
}

fn update_floats(
    values: &mut Floats,
    (free, hit): (&Mask, &Mask),
    palette: &Palette,
    from: usize,
    changed: &mut Mask,
    new: &mut Mask,
) {
    for word in from..WORDS {
        for (mask, update) in [(free[word], Update::Miss), (hit[word], Update::Hit)] {
            for bit in (0..64).filter(|bit| mask >> bit & 1 != 0) {
                let value = &mut values[word * 64 + bit];
                let old = if value.is_nan() { 0.0 } else { *value };
                let next = palette.updated(old, update);
                new[word] |= u64::from(value.is_nan()) << bit;
                changed[word] |= u64::from(value.is_nan() || next != old) << bit;
                *value = next;
            }
        }
    }
}
