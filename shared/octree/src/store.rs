//! The voxels of bricks, each brick in as few bits as it has different values, exactly.

use crate::decoded::Decoded;
use crate::marks::{BrickMarks, Ends};
use crate::mask::{self, Mask, WORDS};
use crate::numbers::{MAX_ENTRIES, Numbers, Stop, set_state, state_of, table_units};
use crate::palette::{Palette, State, UNKNOWN, Update};
use crate::planes;
use crate::units::{Unit, Units};

/// Planes of a brick whose numbers are the first states of the palette.
const FEW: usize = 2;

/// Planes of a brick whose numbers are states, any of them.
const ALL: usize = 16;

/// Units of a brick of plain values: 512 `f32`, two a word, NaN where unknown.
const FLOATS: usize = 32;

/// Where a brick's voxels are, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// All 512 have this state (as OctoMap prunes them to one leaf): no memory of their own.
    Uniform(State),
    /// Bit planes of numbers, and behind them a table of the states of `entries` numbers; without entries a number is a
    /// state.
    Planes { planes: u8, entries: u8, at: u32 },
    /// The last resort where the palette is full.
    Floats(u32),
}

/// No ground flag in the brick.
const NO_GROUND: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
struct Slot {
    form: Form,
    /// Unit of the ground flags or [`NO_GROUND`].
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

/// The palette does not know yet what follows a state: [`Palette::compute`] it and try again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Missing(pub(crate) State, pub(crate) Update);

/// Bricks by index. A map has several stores, so that threads can update one each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Store {
    slots: Vec<Slot>,
    /// Slots without a brick.
    free: Vec<u32>,
    units: Units,
}

impl Store {
    /// Index of a new brick of which nothing is known.
    pub(crate) fn add(&mut self) -> u32 {
        let slot = Slot { form: Form::Uniform(UNKNOWN), ground: NO_GROUND, seen: 0, revision: 0 };
        if let Some(index) = self.free.pop() {
            self.slots[index as usize] = slot;
            return index;
        }
        if self.slots.len() == self.slots.capacity() {
            self.slots.reserve_exact(self.slots.len() / 8 + 64);
        }
        self.slots.push(slot);
        self.slots.len() as u32 - 1
    }

    /// Forgets a brick and gives its memory back.
    pub(crate) fn remove(&mut self, index: u32) {
        self.set_form(index, Form::Uniform(UNKNOWN));
        self.remove_ground(index, &[u64::MAX; WORDS]);
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
    pub(crate) fn value(&self, index: u32, voxel: usize, palette: &Palette) -> Option<f32> {
        let state = match self.slots[index as usize].form {
            Form::Uniform(state) => state,
            Form::Planes { planes, entries, at } => {
                let (planes, table) = self.parts(planes, entries, at);
                state_of(table, planes::get(planes, voxel))
            }
            Form::Floats(at) => {
                let value = self.float(at, voxel);
                return (!value.is_nan()).then_some(value);
            }
        };
        (state != UNKNOWN).then(|| palette.value(state))
    }

    /// The value that all 512 voxels have, where they are known and have one.
    #[inline]
    pub(crate) fn uniform(&self, index: u32, palette: &Palette) -> Option<f32> {
        match self.slots[index as usize].form {
            Form::Uniform(state) if state != UNKNOWN => Some(palette.value(state)),
            _ => None,
        }
    }

    /// The voxels with a value.
    pub(crate) fn known(&self, index: u32) -> Mask {
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => [0; WORDS],
            Form::Uniform(_) => [u64::MAX; WORDS],
            Form::Planes { planes, at, .. } => planes::nonzero(self.units.run(at, planes.into())),
            Form::Floats(at) => std::array::from_fn(|word| {
                (0..64)
                    .fold(0, |bits, bit| bits | u64::from(!self.float(at, word * 64 + bit).is_nan()) << bit)
            }),
        }
    }

    /// The voxels of a brick, at least those of the blocks of eight that `within` reaches.
    pub(crate) fn decode(&self, index: u32, palette: &Palette, within: &Mask, decoded: &mut Decoded) {
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => decoded.unknown(),
            Form::Uniform(state) => decoded.uniform(palette.value(state)),
            Form::Planes { planes, entries, at } => {
                let (planes, table) = self.parts(planes, entries, at);
                decoded.planes(planes, table, entries.into(), within, palette);
            }
            Form::Floats(at) => decoded.floats(self.known(index), |voxel| self.float(at, voxel)),
        }
    }

    /// Calls `visit` with each value of a brick and voxels that have it: a word's equal voxels at a time.
    #[inline]
    pub(crate) fn for_each_value(
        &self,
        index: u32,
        palette: &Palette,
        mut visit: impl FnMut(usize, u64, f32),
    ) {
        match self.slots[index as usize].form {
            Form::Uniform(UNKNOWN) => {}
            Form::Uniform(state) => (0..WORDS).for_each(|word| visit(word, u64::MAX, palette.value(state))),
            Form::Planes { planes, entries, at } => {
                let (planes, table) = self.parts(planes, entries, at);
                for (word, mut left) in planes::nonzero(planes).into_iter().enumerate() {
                    while left != 0 {
                        let (same, number) = planes::alike(planes, word, left);
                        left &= !same;
                        visit(word, same, palette.value(state_of(table, number)));
                    }
                }
            }
            Form::Floats(at) => {
                for voxel in mask::Bits::of(self.known(index)) {
                    visit(voxel / 64, 1 << (voxel % 64), self.float(at, voxel));
                }
            }
        }
    }

    /// The voxels with a ground flag.
    #[inline]
    pub(crate) fn ground(&self, index: u32) -> Mask {
        match self.slots[index as usize].ground {
            NO_GROUND => [0; WORDS],
            at => self.units.run(at, 1)[0],
        }
    }

    /// Gives voxels the ground flag, besides those that have it.
    pub(crate) fn add_ground(&mut self, index: u32, flags: &Mask) {
        let slot = &mut self.slots[index as usize];
        if slot.ground == NO_GROUND {
            slot.ground = self.units.add(1);
            self.units.run_mut(slot.ground, 1)[0] = [0; WORDS];
        }
        let ground = &mut self.units.run_mut(slot.ground, 1)[0];
        ground.iter_mut().zip(flags).for_each(|(word, more)| *word |= more);
    }

    /// Takes the ground flag from voxels.
    fn remove_ground(&mut self, index: u32, flags: &Mask) {
        let slot = &mut self.slots[index as usize];
        if slot.ground == NO_GROUND {
            return;
        }
        let ground = &mut self.units.run_mut(slot.ground, 1)[0];
        ground.iter_mut().zip(flags).for_each(|(word, less)| *word &= !less);
        if mask::is_empty(ground) {
            self.units.remove(std::mem::replace(&mut slot.ground, NO_GROUND), 1);
        }
    }

    /// Gives the voxels of `mask` one value.
    pub(crate) fn assign(&mut self, index: u32, mask: &Mask, value: f32, palette: &mut Palette) {
        if matches!(self.slots[index as usize].form, Form::Floats(_)) {
            self.put_floats(index, mask, value);
            return;
        }
        match palette.state(value) {
            Some(state) => self.put(index, mask, state),
            None => {
                self.make_floats(index, palette);
                self.put_floats(index, mask, value);
            }
        }
    }

    /// Forgets value and flag of the voxels of `mask`.
    pub(crate) fn erase(&mut self, index: u32, mask: &Mask) {
        self.remove_ground(index, mask);
        match self.slots[index as usize].form {
            Form::Floats(_) => self.put_floats(index, mask, f32::NAN),
            _ => self.put(index, mask, UNKNOWN),
        }
    }

    /// Updates each marked voxel once, and says which have a new value or flag. A voxel with a hit in it is not cleared by
    /// the rays that pass it. `stamps` are the numbers of the scan and of the change.
    ///
    /// # Errors
    /// [`Missing`] with the brick as it was.
    pub(crate) fn update(
        &mut self,
        index: u32,
        marks: BrickMarks<'_>,
        changed: &mut Mask,
        (scan, revision): (u32, u32),
        palette: &Palette,
    ) -> Result<Sums, Missing> {
        let old_ground = self.ground(index);
        let mut sums = Sums::default();
        let mut new = [0; WORDS];
        if let Some(Ends { hit, ground }) = marks.ends {
            let free = std::array::from_fn(|word| marks.free[word] & !hit[word]);
            sums.free = mask::count(&free) as u32;
            sums.occupied = mask::count(hit) as u32;
            let hit = (sums.occupied > 0).then_some(hit);
            *changed = self.update_values(index, &free, hit, palette, &mut new)?;
            if !mask::is_empty(ground) {
                self.add_ground(index, ground);
                for word in 0..WORDS {
                    changed[word] |= ground[word] & !old_ground[word];
                }
            }
        } else {
            sums.free = mask::count(marks.free) as u32;
            *changed = self.update_values(index, marks.free, None, palette, &mut new)?;
        }
        sums.changed = mask::count(changed) as u32;
        for (new, ground) in new.iter().zip(&old_ground) {
            sums.new += new.count_ones();
            sums.listed += (new & !ground).count_ones();
        }
        let slot = &mut self.slots[index as usize];
        slot.seen = scan;
        if sums.changed > 0 {
            slot.revision = revision;
        }
        Ok(sums)
    }

    /// Gives the voxels with a new value, and in `new` those that were unknown.
    fn update_values(
        &mut self,
        index: u32,
        free: &Mask,
        hit: Option<&Mask>,
        palette: &Palette,
        new: &mut Mask,
    ) -> Result<Mask, Missing> {
        if let (Form::Uniform(state), None) = (self.slots[index as usize].form, hit) {
            let next = palette.next(state, Update::Miss);
            if next == UNKNOWN {
                return Err(Missing(state, Update::Miss));
            }
            if next == state {
                return Ok([0; WORDS]);
            }
            if *free == [u64::MAX; WORDS] {
                self.slots[index as usize].form = Form::Uniform(next);
                if state == UNKNOWN {
                    *new = *free;
                }
                return Ok(*free);
            }
        }
        let none = [0; WORDS];
        let marks = (free, hit.unwrap_or(&none));
        // Numbers that a second rebuilding in one update must make room for.
        let mut capacity = 0;
        loop {
            let (planes, entries, at) = match self.slots[index as usize].form {
                Form::Uniform(state) => {
                    self.expand(index, state);
                    continue;
                }
                Form::Floats(at) => return Ok(self.update_floats(at, marks, palette, new)),
                Form::Planes { planes, entries, at } => (planes, entries, at),
            };
            let mut changed = [0; WORDS];
            let brick = self.units.run_mut(at, run_length(planes, entries));
            let done = match planes {
                2 => update_planes::<2>(brick, entries, marks, palette, &mut changed, new),
                3 => update_planes::<3>(brick, entries, marks, palette, &mut changed, new),
                4 => update_planes::<4>(brick, entries, marks, palette, &mut changed, new),
                5 => update_planes::<5>(brick, entries, marks, palette, &mut changed, new),
                6 => update_planes::<6>(brick, entries, marks, palette, &mut changed, new),
                7 => update_planes::<7>(brick, entries, marks, palette, &mut changed, new),
                _ => update_planes::<ALL>(brick, entries, marks, palette, &mut changed, new),
            };
            match done {
                Ok(entries) => {
                    self.slots[index as usize].form = Form::Planes { planes, entries, at };
                    if !mask::is_empty(&changed) {
                        self.collapse(index);
                    }
                    return Ok(changed);
                }
                Err(Stop::Missing(state, update)) => return Err(Missing(state, update)),
                Err(Stop::Room) => capacity = 2 * self.rebuild(index, capacity),
            }
        }
    }

    fn put(&mut self, index: u32, mask: &Mask, state: State) {
        if *mask == [u64::MAX; WORDS] {
            self.set_form(index, Form::Uniform(state));
            return;
        }
        loop {
            let (planes, entries, at) = match self.slots[index as usize].form {
                Form::Uniform(common) if common == state => return,
                Form::Uniform(common) => {
                    self.expand(index, common);
                    continue;
                }
                Form::Floats(_) => return,
                Form::Planes { planes, entries, at } => (planes, entries, at),
            };
            let (brick, table) =
                self.units.run_mut(at, run_length(planes, entries)).split_at_mut(planes.into());
            let limit = 1_usize << planes;
            let known = (0..entries).map(u16::from).find(|&number| state_of(table, number) == state);
            let number = match known {
                _ if entries == 0 => Some(state).filter(|state| usize::from(*state) < limit),
                None if usize::from(entries) < limit => {
                    set_state(table, entries.into(), state);
                    self.slots[index as usize].form = Form::Planes { planes, entries: entries + 1, at };
                    Some(u16::from(entries))
                }
                known => known,
            };
            let Some(number) = number else {
                self.rebuild(index, 0);
                continue;
            };
            for (word, mask) in mask.iter().enumerate() {
                planes::put(brick, word, *mask, number);
            }
            self.collapse(index);
            return;
        }
    }

    /// Gives a new brick all its voxels at once; unknown ones are [`UNKNOWN`].
    pub(crate) fn fill(&mut self, index: u32, states_of_brick: &[State; mask::BRICK_VOXELS]) {
        let (mut table, mut entries) = ([UNKNOWN; MAX_ENTRIES], 1);
        let mut masks = [[0; WORDS]; MAX_ENTRIES];
        let mut last = 0;
        for (word, states) in states_of_brick.as_chunks::<64>().0.iter().enumerate() {
            for (bit, &state) in states.iter().enumerate() {
                if state != table[last] {
                    last = match table[..entries].iter().position(|entry| *entry == state) {
                        Some(number) => number,
                        None if entries < MAX_ENTRIES => {
                            table[entries] = state;
                            entries += 1;
                            entries - 1
                        }
                        None => return self.fill_with_states(index, states_of_brick),
                    };
                }
                masks[last][word] |= 1 << bit;
            }
        }
        let few = table[..entries].iter().all(|state| usize::from(*state) < 1 << FEW);
        let mut planes = [[0; WORDS]; ALL];
        for number in 1..entries {
            let mut bits = if few { usize::from(table[number]) } else { number };
            while bits != 0 {
                let plane = &mut planes[bits.trailing_zeros() as usize];
                plane.iter_mut().zip(&masks[number]).for_each(|(word, voxels)| *word |= voxels);
                bits &= bits - 1;
            }
        }
        let bits = if few { FEW } else { entries.next_power_of_two().trailing_zeros().max(3) as usize };
        let entries = if few { 0 } else { entries as u8 };
        let at = self.units.add(run_length(bits as u8, entries));
        let (brick, behind) = self.units.run_mut(at, run_length(bits as u8, entries)).split_at_mut(bits);
        brick.copy_from_slice(&planes[..bits]);
        for (number, state) in table[..usize::from(entries)].iter().enumerate() {
            set_state(behind, number, *state);
        }
        self.set_form(index, Form::Planes { planes: bits as u8, entries, at });
        self.collapse(index);
    }

    fn fill_with_states(&mut self, index: u32, states: &[State; mask::BRICK_VOXELS]) {
        let at = self.units.add(ALL);
        let brick = self.units.run_mut(at, ALL);
        brick.fill([0; WORDS]);
        for (voxel, &state) in states.iter().enumerate() {
            for (n, plane) in brick.iter_mut().enumerate() {
                plane[voxel / 64] |= u64::from(state >> n & 1) << (voxel % 64);
            }
        }
        self.set_form(index, Form::Planes { planes: ALL as u8, entries: 0, at });
    }

    /// Gives the brick planes, in which all voxels have one state.
    fn expand(&mut self, index: u32, state: State) {
        let (planes, entries, number) =
            if usize::from(state) < 1 << FEW { (FEW as u8, 0, state) } else { (3, 2, 1) };
        let at = self.units.add(run_length(planes, entries));
        let (brick, table) = self.units.run_mut(at, run_length(planes, entries)).split_at_mut(planes.into());
        (0..WORDS).for_each(|word| planes::put(brick, word, u64::MAX, number));
        set_state(table, 0, UNKNOWN);
        set_state(table, 1, state);
        self.slots[index as usize].form = Form::Planes { planes, entries, at };
    }

    /// Numbers the states that do occur anew, in planes that hold at least `capacity` numbers and in any case a few more
    /// than there are. Gives how many they hold.
    fn rebuild(&mut self, index: u32, capacity: usize) -> usize {
        let Form::Planes { planes, entries, at } = self.slots[index as usize].form else { return 0 };
        let (old, table) = self.parts(planes, entries, at);
        let numbers = if entries == 0 { 1 << planes } else { u16::from(entries) };
        let (mut states, mut live) = ([UNKNOWN; MAX_ENTRIES], 1);
        let mut fresh = [[0; WORDS]; ALL];
        let mut masks = [[0; WORDS]; MAX_ENTRIES];
        for number in 1..numbers {
            let voxels = planes::equal(old, number);
            if !mask::is_empty(&voxels) {
                (states[live], masks[live]) = (state_of(table, number), voxels);
                live += 1;
            }
        }
        let capacity = capacity.max(live + (live / 4).max(2));
        let bits = capacity.next_power_of_two().trailing_zeros().max(3) as usize;
        let (planes, entries) = if 1 << bits <= MAX_ENTRIES { (bits, live as u8) } else { (ALL, 0) };
        for number in 1..live {
            let written = if entries == 0 { states[number] } else { number as u16 };
            for (word, voxels) in masks[number].iter().enumerate() {
                planes::put(&mut fresh[..planes], word, *voxels, written);
            }
        }
        let at = self.units.add(run_length(planes as u8, entries));
        let (brick, table) = self.units.run_mut(at, run_length(planes as u8, entries)).split_at_mut(planes);
        brick.copy_from_slice(&fresh[..planes]);
        for (number, state) in states[..usize::from(entries)].iter().enumerate() {
            set_state(table, number, *state);
        }
        self.set_form(index, Form::Planes { planes: planes as u8, entries, at });
        1 << planes
    }

    /// Frees the planes of a brick whose voxels have all become equal.
    fn collapse(&mut self, index: u32) {
        if let Form::Planes { planes, entries, at } = self.slots[index as usize].form {
            let (planes, table) = self.parts(planes, entries, at);
            if let Some(number) = planes::uniform(planes) {
                self.set_form(index, Form::Uniform(state_of(table, number)));
            }
        }
    }

    /// Gives a brick plain values, because the palette has no numbers left.
    pub(crate) fn make_floats(&mut self, index: u32, palette: &Palette) {
        if matches!(self.slots[index as usize].form, Form::Floats(_)) {
            return;
        }
        let at = self.units.add(FLOATS);
        let mut values = [f32::NAN; mask::BRICK_VOXELS];
        self.for_each_value(index, palette, |word, voxels, value| {
            (0..64).filter(|bit| voxels >> bit & 1 != 0).for_each(|bit| values[word * 64 + bit] = value);
        });
        self.set_form(index, Form::Floats(at));
        for (voxel, value) in values.into_iter().enumerate() {
            self.set_float(at, voxel, value);
        }
    }

    fn put_floats(&mut self, index: u32, mask: &Mask, value: f32) {
        if let Form::Floats(at) = self.slots[index as usize].form {
            mask::Bits::of(*mask).for_each(|voxel| self.set_float(at, voxel, value));
        }
    }

    fn update_floats(
        &mut self,
        at: u32,
        (free, hit): (&Mask, &Mask),
        palette: &Palette,
        new: &mut Mask,
    ) -> Mask {
        let mut changed = [0; WORDS];
        for (mask, update) in [(free, Update::Miss), (hit, Update::Hit)] {
            for voxel in mask::Bits::of(*mask) {
                let value = self.float(at, voxel);
                let old = if value.is_nan() { 0.0 } else { value };
                let next = palette.updated(old, update);
                if value.is_nan() {
                    mask::set(new, voxel);
                }
                if value.is_nan() || next != old {
                    mask::set(&mut changed, voxel);
                    self.set_float(at, voxel, next);
                }
            }
        }
        changed
    }

    fn float(&self, at: u32, voxel: usize) -> f32 {
        let word = self.units.run(at, FLOATS)[voxel / 16][voxel / 2 % 8];
        f32::from_bits((word >> (32 * (voxel % 2))) as u32)
    }

    fn set_float(&mut self, at: u32, voxel: usize, value: f32) {
        let (word, shift) =
            (&mut self.units.run_mut(at, FLOATS)[voxel / 16][voxel / 2 % 8], 32 * (voxel % 2));
        *word = *word & !(0xffff_ffff << shift) | u64::from(value.to_bits()) << shift;
    }

    /// A brick's planes and its table.
    #[inline]
    fn parts(&self, planes: u8, entries: u8, at: u32) -> (&[Unit], &[Unit]) {
        self.units.run(at, run_length(planes, entries)).split_at(planes.into())
    }

    /// Gives back what the old form held.
    fn set_form(&mut self, index: u32, form: Form) {
        match std::mem::replace(&mut self.slots[index as usize].form, form) {
            Form::Uniform(_) => {}
            Form::Planes { planes, entries, at } => self.units.remove(at, run_length(planes, entries)),
            Form::Floats(at) => self.units.remove(at, FLOATS),
        }
    }

    /// Bytes held that hold nothing now.
    pub(crate) fn free_bytes(&self) -> usize {
        (self.slots.capacity() - self.slots.len() + self.free.len()) * size_of::<Slot>()
            + self.units.free_bytes()
    }

    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.slots.capacity() * size_of::<Slot>() + self.free.capacity() * 4 + self.units.memory_bytes()
    }
}

/// Units of a brick.
fn run_length(planes: u8, entries: u8) -> usize {
    let planes = usize::from(planes);
    if entries == 0 { planes } else { planes + table_units(planes) }
}

/// Updates a brick of P planes, state by state, since few states occur among 64 neighbours. Gives the new number of table
/// entries.
///
/// # Errors
/// [`Stop`] with the brick unchanged.
#[inline]
fn update_planes<const P: usize>(
    brick: &mut [Unit],
    entries: u8,
    (free, hit): (&Mask, &Mask),
    palette: &Palette,
    changed: &mut Mask,
    new: &mut Mask,
) -> Result<u8, Stop> {
    let Some((stored, table)) = brick.split_first_chunk_mut::<P>() else { return Ok(entries) };
    let mut numbers = Numbers::new(palette, P, table, entries.into());
    let mut planes = *stored;
    let mut fresh = [0; WORDS];
    for word in 0..WORDS {
        for (marked, update) in [(free[word], Update::Miss), (hit[word], Update::Hit)] {
            let mut left = marked;
            while left != 0 {
                let (same, number) = planes::alike(&planes, word, left);
                left &= !same;
                let next = numbers.next(number, update)?;
                if next != number {
                    planes::put(&mut planes, word, same, next);
                    changed[word] |= same;
                    fresh[word] |= if number == 0 { same } else { 0 };
                }
            }
        }
    }
    *new = fresh;
    *stored = planes;
    for (number, state) in numbers.states().iter().enumerate().skip(entries.into()) {
        set_state(table, number, *state);
    }
    Ok(numbers.states().len() as u8)
}
