//! The log-odds values that occur, numbered: a voxel is kept as the number of its value.

use crate::SensorModel;

/// Number of a value in a [`Palette`].
pub(crate) type State = u16;

/// The state of a voxel that nothing is known of; its value is zero, the log-odds of the prior of 0.5.
pub(crate) const UNKNOWN: State = 0;

/// How a ray changes a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Update {
    /// It passed through.
    Miss,
    /// It ended there.
    Hit,
}

/// Exact `f32` values by number, and which value follows which.
///
/// A value gets its number when it first occurs, so that the values that a map begins with have the smallest. Updates
/// never compute a sum twice: the first time a value is missed (hit), the number of the sum is kept.
#[derive(Clone, Debug)]
pub(crate) struct Palette {
    sensor: SensorModel,
    values: Vec<f32>,
    /// By state, after a miss and after a hit; [`UNKNOWN`] where not yet computed.
    next: Vec<[State; 2]>,
    /// States by the hash of their value: open addressing, a power of two long, at most half full.
    table: Vec<State>,
    /// States whose value occurs nowhere.
    free: Vec<State>,
    /// Kept for the next [`Self::recycle`]: which states occur.
    used: Vec<bool>,
}

/// Most numbers.
const NUMBERS: usize = 1 << 16;

/// Numbers that the values of one scan may need.
const SCAN: usize = 128;

/// Numbers that a map begins with.
const FIRST: usize = 512;

/// States that have their number for ever.
const FIXED: usize = 4;

impl Palette {
    pub(crate) fn new(sensor: SensorModel) -> Self {
        let mut palette = Self {
            sensor,
            values: Vec::with_capacity(FIRST),
            next: Vec::with_capacity(FIRST),
            table: vec![UNKNOWN; 2 * FIRST],
            free: Vec::with_capacity(FIRST),
            used: Vec::with_capacity(FIRST),
        };
        palette.values.push(0.0);
        palette.next.push([UNKNOWN; 2]);
        // Seen once, hit once and surely free fit into two bits.
        for update in [Update::Miss, Update::Hit] {
            palette.compute(UNKNOWN, update);
        }
        palette.state(sensor.clamp_min);
        palette
    }

    /// Log-odds of a state.
    #[inline]
    pub(crate) fn value(&self, state: State) -> f32 {
        self.values[usize::from(state)]
    }

    /// The state of a value, bit by bit; `None` where there are 65,535 others already.
    pub(crate) fn state(&mut self, value: f32) -> Option<State> {
        let mut entry = self.home(value);
        loop {
            match self.table[entry] {
                UNKNOWN => break,
                state if self.value(state).to_bits() == value.to_bits() => return Some(state),
                _ => entry = (entry + 1) & (self.table.len() - 1),
            }
        }
        if let Some(state) = self.free.pop() {
            self.values[usize::from(state)] = value;
            self.table[entry] = state;
            return Some(state);
        }
        let state = State::try_from(self.values.len()).ok()?;
        self.values.push(value);
        self.next.push([UNKNOWN; 2]);
        self.table[entry] = state;
        if self.values.len() * 2 > self.table.len() {
            self.grow();
        }
        Some(state)
    }

    /// The state after an update; [`UNKNOWN`] where it was never [computed](Self::compute).
    #[inline]
    pub(crate) fn next(&self, state: State, update: Update) -> State {
        self.next[usize::from(state)][update as usize]
    }

    /// The value after an update.
    pub(crate) fn updated(&self, value: f32, update: Update) -> f32 {
        match update {
            Update::Miss => self.sensor.missed(value),
            Update::Hit => self.sensor.struck(value),
        }
    }

    /// Whether a voxel of this value is occupied.
    #[inline]
    pub(crate) fn occupies(&self, value: f32) -> bool {
        self.sensor.is_occupied(value)
    }

    /// Whether a voxel that was not occupied may be after a ray has passed it: an unknown one of a model that takes what
    /// is below a half for occupied.
    #[inline]
    pub(crate) fn a_miss_may_occupy(&self) -> bool {
        self.occupies(self.sensor.missed(0.0))
    }

    /// Computes what follows a state; `false` where its value has no number any more.
    #[cold]
    pub(crate) fn compute(&mut self, state: State, update: Update) -> bool {
        let Some(next) = self.state(self.updated(self.value(state), update)) else { return false };
        self.next[usize::from(state)][update as usize] = next;
        true
    }

    /// Whether there may be too few numbers for another scan.
    #[inline]
    pub(crate) fn is_nearly_full(&self) -> bool {
        self.values.capacity().min(NUMBERS) - self.values.len() + self.free.len() < SCAN
    }

    /// Takes their numbers from the values that occur nowhere: `mark` notes those that do, by state. Where that gives
    /// little, there is room for twice as many from now on.
    pub(crate) fn recycle(&mut self, mark: impl FnOnce(&mut [bool])) {
        let mut used = std::mem::take(&mut self.used);
        used.clear();
        used.resize(self.values.len(), false);
        used[..FIXED.min(self.values.len())].fill(true);
        mark(&mut used);
        self.free.clear();
        self.free.extend((0..used.len()).rev().filter(|&state| !used[state]).map(|state| state as State));
        for (state, next) in self.next.iter_mut().enumerate() {
            for next in next {
                if !used[state] || !used[usize::from(*next)] {
                    *next = UNKNOWN;
                }
            }
        }
        let numbers = self.values.capacity();
        if self.free.len() < numbers / 4 && numbers < NUMBERS {
            let more = 2 * numbers - self.values.len();
            self.values.reserve_exact(more);
            self.next.reserve_exact(more);
            self.free.reserve_exact(2 * numbers - self.free.len());
            used.reserve_exact(more);
        }
        self.fill_table((2 * self.values.capacity()).next_power_of_two(), &used);
        self.used = used;
    }

    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.values.capacity() * 4
            + self.next.capacity() * 4
            + (self.table.capacity() + self.free.capacity()) * 2
            + self.used.capacity()
    }

    fn grow(&mut self) {
        // Numbers are free only after recycling, and then used before others are added.
        self.fill_table(self.table.len() * 2, &vec![true; self.values.len()]);
    }

    fn fill_table(&mut self, length: usize, used: &[bool]) {
        self.table.clear();
        self.table.resize(length, UNKNOWN);
        for state in (1..self.values.len()).filter(|&state| used[state]) {
            let mut entry = self.home(self.values[state]);
            while self.table[entry] != UNKNOWN {
                entry = (entry + 1) & (self.table.len() - 1);
            }
            self.table[entry] = state as State;
        }
    }

    /// First entry to look at: the high bits of a Fibonacci hash.
    fn home(&self, value: f32) -> usize {
        let hash = u64::from(value.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (hash >> (64 - self.table.len().trailing_zeros())) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_stands_for_exactly_one_value_and_follows_the_sensor_model() {
        let sensor = SensorModel::default();
        let mut palette = Palette::new(sensor);
        let mut value = 0.0;
        let mut state = UNKNOWN;
        for n in 0..500_u32 {
            let update = if n.wrapping_mul(2_654_435_761) >> 30 == 0 { Update::Hit } else { Update::Miss };
            value = palette.updated(value, update);
            assert!(palette.next(state, update) != UNKNOWN || palette.compute(state, update));
            state = palette.next(state, update);
            assert_eq!(palette.value(state).to_bits(), value.to_bits());
            assert_eq!(palette.state(value), Some(state));
        }
    }

    #[test]
    fn what_a_first_scan_leaves_fits_into_two_bits() {
        let palette = Palette::new(SensorModel::default());
        assert!((1..4).contains(&palette.next(UNKNOWN, Update::Miss)));
        assert!((1..4).contains(&palette.next(UNKNOWN, Update::Hit)));
    }

    #[test]
    fn a_full_palette_says_so_and_keeps_what_it_has() {
        let mut palette = Palette::new(SensorModel::default());
        let numbered = (0..70_000_u32).filter(|n| palette.state(1.0 + *n as f32 * 1e-4).is_some()).count();
        assert!(numbered > 65_000 && numbered < 65_536);
        assert_eq!(palette.state(palette.value(7)), Some(7));
        let last = palette.state(1.0).unwrap();
        assert!(!palette.compute(last, Update::Miss));
        assert_eq!(palette.next(last, Update::Miss), UNKNOWN);
    }

    #[test]
    fn numbers_of_values_that_occur_nowhere_are_given_anew() {
        let mut palette = Palette::new(SensorModel::default());
        let first: Vec<State> = (0..300).map(|n| palette.state(n as f32 * 0.01 + 0.005).unwrap()).collect();
        assert!(palette.compute(first[0], Update::Hit) && palette.compute(first[7], Update::Miss));
        let kept = first[7];
        palette.recycle(|used| used[usize::from(kept)] = true);
        assert_eq!(palette.next(first[7], Update::Miss), UNKNOWN, "its successor has gone");
        let held = palette.memory_bytes();
        for round in 0..50 {
            let states: Vec<State> =
                (0..200).map(|n| palette.state(-1.5 - (round * 200 + n) as f32 * 1e-4).unwrap()).collect();
            assert!(!states.contains(&kept) && states.iter().all(|state| usize::from(*state) >= FIXED));
            for (n, &state) in states.iter().enumerate() {
                assert_eq!(palette.state(palette.value(state)), Some(state), "{n}");
            }
            palette.recycle(|used| used[usize::from(kept)] = true);
        }
        assert_eq!((palette.value(kept), palette.memory_bytes()), (0.075, held));
    }
}
