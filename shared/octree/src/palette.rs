//! The log-odds values that occur, numbered: a voxel is kept as the number of its value.

use rustc_hash::FxHashMap;

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
/// A value gets its number when it first occurs, so that the few values that almost all voxels have get small numbers,
/// which need few bits. Updates never compute a sum twice: the first time a value is missed (hit), the number of the
/// sum is kept.
#[derive(Clone, Debug)]
pub(crate) struct Palette {
    sensor: SensorModel,
    values: Vec<f32>,
    /// By state; [`UNKNOWN`] where not yet computed.
    missed: Vec<State>,
    struck: Vec<State>,
    states: FxHashMap<u32, State>,
}

impl Palette {
    pub(crate) fn new(sensor: SensorModel) -> Self {
        let mut palette = Self {
            sensor,
            values: vec![0.0],
            missed: vec![UNKNOWN],
            struck: vec![UNKNOWN],
            states: FxHashMap::default(),
        };
        // Seen once, hit once and surely free fit into two bits; what follows when one goes on into four.
        let (miss, hit) = (sensor.missed(0.0), sensor.struck(0.0));
        palette.state(miss);
        palette.state(hit);
        palette.state(sensor.clamp_min);
        palette.state(sensor.clamp_max);
        let (mut free, mut occupied) = (miss, hit);
        for _ in 0..4 {
            (free, occupied) = (sensor.missed(free), sensor.struck(occupied));
            palette.state(free);
            palette.state(occupied);
        }
        palette
    }

    /// Log-odds of a state.
    #[inline]
    pub(crate) fn value(&self, state: State) -> f32 {
        self.values[usize::from(state)]
    }

    /// All values, by state.
    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    /// The state of a value, bit by bit; `None` where there are 65,535 others already.
    pub(crate) fn state(&mut self, value: f32) -> Option<State> {
        if let Some(&state) = self.states.get(&value.to_bits()) {
            return Some(state);
        }
        let state = State::try_from(self.values.len()).ok()?;
        self.values.push(value);
        self.missed.push(UNKNOWN);
        self.struck.push(UNKNOWN);
        self.states.insert(value.to_bits(), state);
        Some(state)
    }

    /// The state after an update; `None` where its value has no number any more.
    #[inline]
    pub(crate) fn next(&mut self, state: State, update: Update) -> Option<State> {
        let known = match update {
            Update::Miss => self.missed[usize::from(state)],
            Update::Hit => self.struck[usize::from(state)],
        };
        if known == UNKNOWN { self.compute(state, update) } else { Some(known) }
    }

    /// The value after an update.
    pub(crate) fn updated(&self, value: f32, update: Update) -> f32 {
        match update {
            Update::Miss => self.sensor.missed(value),
            Update::Hit => self.sensor.struck(value),
        }
    }

    #[cold]
    fn compute(&mut self, state: State, update: Update) -> Option<State> {
        let next = self.state(self.updated(self.value(state), update))?;
        match update {
            Update::Miss => self.missed[usize::from(state)] = next,
            Update::Hit => self.struck[usize::from(state)] = next,
        }
        Some(next)
    }

    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.values.capacity() * 4
            + (self.missed.capacity() + self.struck.capacity()) * size_of::<State>()
            + crate::directory::table_bytes(self.states.capacity(), size_of::<(u32, State)>())
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
            state = palette.next(state, update).unwrap();
            assert_eq!(palette.value(state).to_bits(), value.to_bits());
            assert_eq!(palette.state(value), Some(state));
        }
    }

    #[test]
    fn what_a_first_scan_leaves_fits_into_two_bits() {
        let mut palette = Palette::new(SensorModel::default());
        assert!(palette.next(UNKNOWN, Update::Miss).unwrap() < 4);
        assert!(palette.next(UNKNOWN, Update::Hit).unwrap() < 4);
    }

    #[test]
    fn a_full_palette_says_so() {
        let mut palette = Palette::new(SensorModel::default());
        let numbered = (0..70_000_u32).filter(|n| palette.state(1.0 + *n as f32 * 1e-4).is_some()).count();
        assert_eq!(palette.values().len(), 65_536);
        assert!(numbered < 65_536);
        assert!(palette.state(palette.value(7)).is_some());
    }
}
