//! Voxel states as bit planes: the n-th bit of 64 voxels' states in one word, so that all voxels of one state are
//! found, and changed, by a handful of word operations.

use crate::palette::{Palette, State, UNKNOWN, Update};

/// An update gave a state that has more bits than the brick has planes, or no number at all.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Overflow {
    /// It needs so large a state.
    State(State),
    /// The palette is full.
    Palette,
}

/// What an update did to a word's voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct WordChange {
    /// Voxels with a new value.
    pub(crate) changed: u64,
    /// Voxels that were unknown.
    pub(crate) new: u64,
}

/// The state of one voxel.
#[inline]
pub(crate) fn get<const P: usize>(planes: &[u64; P], bit: u32) -> State {
    let mut state = 0;
    for (plane, word) in planes.iter().enumerate() {
        state |= ((word >> bit & 1) as State) << plane;
    }
    state
}

/// Gives the voxels of `mask` one state.
#[inline]
pub(crate) fn put<const P: usize>(planes: &mut [u64; P], mask: u64, state: State) {
    for (plane, word) in planes.iter_mut().enumerate() {
        *word = *word & !mask | mask & spread(state, plane);
    }
}

/// The voxels that have a state at all.
#[inline]
pub(crate) fn known<const P: usize>(planes: &[u64; P]) -> u64 {
    planes.iter().fold(0, |all, word| all | word)
}

/// The common state of all 64 voxels, if they have one.
#[inline]
pub(crate) fn uniform<const P: usize>(planes: &[u64; P]) -> Option<State> {
    let mut state = 0;
    for (plane, word) in planes.iter().enumerate() {
        match *word {
            0 => {}
            u64::MAX => state |= 1 << plane,
            _ => return None,
        }
    }
    Some(state)
}

/// The voxels of `among` that have the same state as the voxel `bit`, and that state.
#[inline]
pub(crate) fn alike<const P: usize>(planes: &[u64; P], among: u64, bit: u32) -> (u64, State) {
    let (mut same, mut state) = (among, 0);
    for (plane, word) in planes.iter().enumerate() {
        let one = word >> bit & 1;
        state |= (one as State) << plane;
        same &= !(word ^ one.wrapping_neg());
    }
    (same, state)
}

/// Updates the voxels of `mask`, each once: state by state, since few states occur among 64 neighbours.
///
/// # Errors
/// [`Overflow`] with the word unchanged.
#[inline]
pub(crate) fn update<const P: usize>(
    planes: &mut [u64; P],
    mask: u64,
    update: Update,
    palette: &mut Palette,
) -> Result<WordChange, Overflow> {
    let mut after = *planes;
    let mut change = WordChange::default();
    let mut left = mask;
    while left != 0 {
        let (same, state) = alike(planes, left, left.trailing_zeros());
        left &= !same;
        let next = palette.next(state, update).ok_or(Overflow::Palette)?;
        if next == state {
            continue;
        }
        if P < 16 && next >> P != 0 {
            return Err(Overflow::State(next));
        }
        put(&mut after, same, next);
        change.changed |= same;
        if state == UNKNOWN {
            change.new |= same;
        }
    }
    *planes = after;
    Ok(change)
}

#[inline]
fn spread(state: State, plane: usize) -> u64 {
    u64::from(state >> plane & 1).wrapping_neg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorModel;

    #[test]
    fn planes_update_as_single_voxels_do() {
        let sensor = SensorModel::default();
        let mut palette = Palette::new(sensor);
        let (mut planes, mut plain) = ([0_u64; 8], [None::<f32>; 64]);
        let mut random = 1_u64;
        for round in 0..60 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let mask = random ^ random >> 31;
            let kind = if round % 3 == 0 { Update::Hit } else { Update::Miss };
            let before = planes;
            let Ok(change) = update(&mut planes, mask, kind, &mut palette) else {
                assert_eq!(planes, before);
                continue;
            };
            for (bit, value) in plain.iter_mut().enumerate() {
                let old = *value;
                if mask >> bit & 1 != 0 {
                    *value = Some(palette.updated(old.unwrap_or(0.0), kind));
                }
                let state = get(&planes, bit as u32);
                assert_eq!(known(&planes) >> bit & 1 != 0, value.is_some());
                assert_eq!((state != UNKNOWN).then(|| palette.value(state)), *value);
                assert_eq!(change.changed >> bit & 1 != 0, old != *value);
                assert_eq!(change.new >> bit & 1 != 0, old.is_none() && value.is_some());
            }
        }
        assert!(plain.iter().all(Option::is_some));
    }

    #[test]
    fn a_state_that_needs_more_planes_is_refused_before_anything_changes() {
        let mut palette = Palette::new(SensorModel::default());
        let mut planes = [0_u64; 2];
        assert_eq!(update(&mut planes, 0b101, Update::Miss, &mut palette).unwrap().new, 0b101);
        let before = planes;
        let second = update(&mut planes, 0b111, Update::Miss, &mut palette);
        assert!(matches!(second, Err(Overflow::State(state)) if state > 3));
        assert_eq!(planes, before);
    }

    #[test]
    fn equal_voxels_are_told_from_others() {
        let mut planes = [0_u64; 4];
        put(&mut planes, u64::MAX, 9);
        assert_eq!(uniform(&planes), Some(9));
        put(&mut planes, 1 << 40, 8);
        assert_eq!((uniform(&planes), get(&planes, 40), get(&planes, 41)), (None, 8, 9));
        assert_eq!(alike(&planes, u64::MAX, 40), (1 << 40, 8));
    }
}
