//! Bricks move together where much between them has become free.

use super::{FLOATS, Form, NO_GROUND, Store, run_length};

/// Most bricks that are looked at, and moved, after one scan.
const LOOKS: usize = 2048;
const MOVES: usize = 128;

impl Store {
    /// Moves some bricks from the end of the memory to free places before, and gives back the pages that are then empty.
    /// What this leaves free is a tenth of what is used.
    pub(crate) fn tidy(&mut self) {
        let Some(end) = self.units.excess() else { return };
        let mut moves = 0;
        for _ in 0..LOOKS.min(self.slots.len()) {
            self.cursor = if self.cursor + 1 < self.slots.len() { self.cursor + 1 } else { 0 };
            let slot = &mut self.slots[self.cursor];
            let (at, length) = match &mut slot.form {
                Form::Uniform(_) => (None, 0),
                Form::Planes { planes, entries, at } => (Some(at), run_length(*planes, *entries)),
                Form::Floats(at) => (Some(at), FLOATS),
            };
            let ground = Some(&mut slot.ground).filter(|at| **at != NO_GROUND);
            for (at, length) in [(at, length), (ground, 1)] {
                let Some(at) = at.filter(|at| **at >= end) else { continue };
                if let Some(new) = self.units.move_before(*at, length, end) {
                    *at = new;
                    moves += 1;
                }
            }
            if moves >= MOVES {
                break;
            }
        }
        self.units.shrink(end);
    }
}
