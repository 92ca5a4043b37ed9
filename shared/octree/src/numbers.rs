//! What the numbers in a brick's planes mean, and which number follows which.

use crate::palette::{Palette, State, UNKNOWN, Update};
use crate::units::Unit;

/// Most numbers that have a table of their own.
pub(crate) const MAX_ENTRIES: usize = 128;

/// Why an update did not go through. The brick is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stop {
    /// The palette does not know yet what follows this state.
    Missing(State, Update),
    /// The brick needs more numbers than its planes can hold.
    Room,
}

/// Units that the table of a brick with so many planes takes: 32 states each.
pub(crate) fn table_units(planes: usize) -> usize {
    (1_usize << planes).div_ceil(32)
}

/// The state that a number stands for in the table behind a brick's planes; without a table the number itself.
#[inline]
pub(crate) fn state_of(table: &[Unit], number: u16) -> State {
    let n = usize::from(number);
    match table.get(n / 32) {
        Some(unit) => (unit[n / 4 % 8] >> (16 * (n % 4))) as State,
        None => number,
    }
}

/// Writes a table's entry.
pub(crate) fn set_state(table: &mut [Unit], number: usize, state: State) {
    if let Some(unit) = table.get_mut(number / 32) {
        let (word, shift) = (&mut unit[number / 4 % 8], 16 * (number % 4));
        *word = *word & !(0xffff << shift) | u64::from(state) << shift;
    }
}

/// The numbers of one brick while it is updated.
pub(crate) struct Numbers<'a> {
    palette: &'a Palette,
    /// States by number; number 0 is [`UNKNOWN`]. Empty where a number is a state.
    states: [State; MAX_ENTRIES],
    entries: usize,
    limit: usize,
    /// The number after a miss and a hit, where already looked up.
    next: [[u8; 2]; MAX_ENTRIES],
}

/// Not looked up yet.
const NOT_YET: u8 = u8::MAX;

impl<'a> Numbers<'a> {
    /// The numbers of a brick with so many planes and so many table entries (0: no table).
    pub(crate) fn new(palette: &'a Palette, planes: usize, table: &[Unit], entries: usize) -> Self {
        let mut states = [UNKNOWN; MAX_ENTRIES];
        for (number, state) in states[..entries].iter_mut().enumerate() {
            *state = state_of(table, number as u16);
        }
        Self { palette, states, entries, limit: 1 << planes, next: [[NOT_YET; 2]; MAX_ENTRIES] }
    }

    /// The number after an update.
    #[inline]
    pub(crate) fn next(&mut self, number: u16, update: Update) -> Result<u16, Stop> {
        if self.entries == 0 {
            let next = self.palette.next(number, update);
            return match next {
                UNKNOWN => Err(Stop::Missing(number, update)),
                _ if usize::from(next) >= self.limit => Err(Stop::Room),
                _ => Ok(next),
            };
        }
        match self.next[usize::from(number)][update as usize] {
            NOT_YET => self.look_up(number, update),
            next => Ok(u16::from(next)),
        }
    }

    fn look_up(&mut self, number: u16, update: Update) -> Result<u16, Stop> {
        let state = self.states[usize::from(number)];
        let next = self.palette.next(state, update);
        if next == UNKNOWN {
            return Err(Stop::Missing(state, update));
        }
        let found = self.states[..self.entries].iter().position(|state| *state == next);
        let found = match found {
            Some(found) => found,
            None if self.entries < self.limit => {
                self.states[self.entries] = next;
                self.entries += 1;
                self.entries - 1
            }
            None => return Err(Stop::Room),
        };
        self.next[usize::from(number)][update as usize] = found as u8;
        Ok(found as u16)
    }

    /// Table entries, with those that were added.
    pub(crate) fn states(&self) -> &[State] {
        &self.states[..self.entries]
    }
}
