//! What a scan does to a brick.

use super::{ALL, Form, Store, run_length};
use crate::marks::{BrickMarks, Ends};
use crate::mask::{self, Mask, WORDS};
use crate::numbers::{Numbers, Stop, set_state};
use crate::palette::{Palette, State, UNKNOWN, Update};
use crate::planes;
use crate::units::Unit;

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

impl Store {
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
        if let Some(Ends { hit, .. }) = marks.ends {
            slot.occupied |= mask::words(hit);
        }
        if palette.a_miss_may_occupy() {
            slot.occupied |= mask::words(marks.free);
        }
        // Who has walked on leaves words without occupied voxels. That is looked for now and then.
        let look =
            slot.occupied != 0 && sums.occupied == 0 && sums.changed > 0 && (scan ^ index).is_multiple_of(8);
        slot.seen = scan;
        if sums.changed > 0 {
            slot.revision = revision;
        }
        if look {
            self.find_occupied(index, palette);
        }
        Ok(sums)
    }

    /// Gives the voxels with a new value, and in `new` those that were unknown.
    pub(super) fn update_values(
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
                    self.expand(index, state, palette);
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
