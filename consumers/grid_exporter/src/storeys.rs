//! Which storeys there are: the heights at which the path is long, told apart by heights at which it is not.

use std::collections::BTreeMap;

use crate::walk::{BIN_M, Bin};

/// Least height between two storeys, metres: a person and a slab.
const APART_M: f64 = 2.2;
/// Bins that count to one height on each side: the gait, a kerb, and what the odometry drifts.
const BESIDE: i32 = 1;
/// Positions on even floor that make a storey: 5 m of way. A landing has less.
const MIN_POINTS: u32 = 50;
/// Most storeys; those with the longest ways stay.
const MAX_STOREYS: usize = 16;

/// Bins of the storeys' floors, in the order in which they were entered; one at least where there is any height.
///
/// A storey is a peak of the histogram with at least [`MIN_POINTS`], [`APART_M`] from any higher one, and with a valley of at
/// most half its height towards each: a ramp that is walked evenly from one height to another is one storey.
pub(crate) fn find(heights: &BTreeMap<i32, Bin>) -> Vec<i32> {
    let points = |bin: i32| heights.get(&bin).map_or(0, |bin| u64::from(bin.points));
    let smooth = |bin: i32| 2 * points(bin) + points(bin - 1) + points(bin + 1);
    let mut peaks: Vec<(i32, u64)> = heights.keys().map(|bin| (*bin, smooth(*bin))).collect();
    peaks.sort_by_key(|(bin, height)| (std::cmp::Reverse(*height), *bin));

    let mut found: Vec<(i32, u64)> = Vec::new();
    for (bin, height) in peaks {
        let near: u64 = (bin - BESIDE..=bin + BESIDE).map(points).sum();
        let parted = |(other, _): &(i32, u64)| {
            let apart = f64::from((bin - other).abs()) * BIN_M >= APART_M - BIN_M / 2.0;
            let valley = (bin.min(*other) + 1..bin.max(*other)).map(smooth).min();
            apart && valley.is_some_and(|valley| 2 * valley <= height)
        };
        let long = found.is_empty() || near >= u64::from(MIN_POINTS);
        if long && found.len() < MAX_STOREYS && found.iter().all(parted) {
            found.push((bin, height));
        }
    }
    let reach = (APART_M / 2.0 / BIN_M).floor() as i32;
    let entered = |bin: i32| heights.range(bin - reach..=bin + reach).map(|(_, bin)| bin.first).min();
    found.sort_by_key(|(bin, _)| (entered(*bin), *bin));
    found.into_iter().map(|(bin, _)| bin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heights(bins: &[(i32, u32)]) -> BTreeMap<i32, Bin> {
        bins.iter().zip(0..).map(|((bin, points), first)| (*bin, Bin { points: *points, first })).collect()
    }

    #[test]
    fn two_floors_and_a_landing_are_two_storeys_in_the_order_in_which_they_were_entered() {
        assert_eq!(find(&heights(&[(0, 200), (8, 30), (9, 5), (17, 90)])), [0, 17]);
        assert_eq!(find(&heights(&[(17, 90), (8, 30), (0, 200)])), [17, 0]);
    }

    #[test]
    fn a_first_step_makes_a_storey_and_a_short_look_at_another_floor_does_not() {
        assert_eq!(find(&heights(&[(0, 1)])), [0]);
        assert_eq!(find(&heights(&[(0, 100), (17, 40)])), [0]);
        assert!(find(&heights(&[])).is_empty());
    }

    #[test]
    fn a_long_even_ramp_is_one_storey_and_drift_of_the_odometry_makes_none() {
        let ramp: Vec<(i32, u32)> = (0..25).map(|bin| (bin, 40)).collect();
        assert_eq!(find(&heights(&ramp)).len(), 1);
        assert_eq!(find(&heights(&[(-2, 50), (-1, 300), (0, 500), (1, 400), (2, 100)])), [0]);
    }

    #[test]
    fn a_mezzanine_lower_than_a_person_belongs_to_its_storey() {
        assert_eq!(find(&heights(&[(0, 300), (8, 200)])), [0]);
    }
}
