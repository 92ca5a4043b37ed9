//! The outlier filter of whole clouds against comparing every pair.

#![allow(clippy::unwrap_used)]

use evac_octree_mapper::{BoundsConfig, CloudFilter, CloudFilterConfig, CloudOutlierConfig};
use proptest::prelude::*;

/// Sorted, so that the order in which they came does not matter.
fn sorted(mut points: Vec<[f32; 3]>) -> Vec<[u32; 3]> {
    points.sort_by(|a, b| a.partial_cmp(b).unwrap());
    points.into_iter().map(|point| point.map(f32::to_bits)).collect()
}

fn brute_force(points: &[[f32; 3]], radius: f32, min_neighbours: u8) -> Vec<[f32; 3]> {
    let near = |a: &[f32; 3], b: &[f32; 3]| {
        a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() <= radius * radius
    };
    let inlier = |a: &&[f32; 3]| {
        points.iter().filter(|b| near(a, b)).take(usize::from(min_neighbours) + 1).count()
            > usize::from(min_neighbours)
    };
    points.iter().filter(inlier).copied().collect()
}

fn filtered(points: &[[f32; 3]], radius_m: f64, min_neighbours: u8, batch: usize) -> (Vec<[f32; 3]>, u64) {
    let filter = CloudFilter::new(CloudFilterConfig {
        outliers: Some(CloudOutlierConfig { radius_m, min_neighbours }),
        bounds: BoundsConfig::default(),
        ground: None,
        reach_m: 1e6,
    });
    let mut kept = Vec::new();
    let mut source = points;
    let removed = filter.unwrap().with_batch(batch).run(&mut source, |point, _| kept.push(point)).unwrap();
    assert_eq!(removed.kept + removed.outliers, points.len() as u64);
    (kept, removed.outliers)
}

#[track_caller]
fn assert_same(points: &[[f32; 3]], radius: f32, min_neighbours: u8, batch: usize) -> u64 {
    let expected = brute_force(points, radius, min_neighbours);
    let (kept, outliers) = filtered(points, f64::from(radius), min_neighbours, batch);
    assert_eq!(outliers, (points.len() - expected.len()) as u64);
    assert_eq!(sorted(kept), sorted(expected));
    outliers
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn clouds_of_any_density_lose_exactly_the_points_that_every_pair_says(
        side in 0.2f32..6.0,
        flat: bool,
        shift in -3000.0f32..3000.0,
        unit in proptest::collection::vec((0.0f32..1.0, 0.0f32..1.0, 0.0f32..1.0), 0..600),
        min_neighbours in 1u8..12,
        batch in 1usize..400,
    ) {
        let points: Vec<[f32; 3]> = unit
            .iter()
            .map(|(x, y, z)| [shift + side * x, side * y - 0.5 * side, if flat { 0.01 * z } else { side * z }])
            .collect();
        assert_same(&points, 0.25, min_neighbours, batch);
    }
}

#[test]
fn equal_points_are_neighbours_of_each_other_but_not_of_themselves() {
    assert_eq!(assert_same(&[[1.0; 3]; 3], 0.1, 2, 10), 0);
    assert_eq!(assert_same(&[[1.0; 3]; 2], 0.1, 2, 10), 2);
    assert_eq!(assert_same(&[], 0.1, 2, 10), 0);
    // More than the counts can hold.
    assert_eq!(assert_same(&[[-1.0; 3]; 300], 0.1, 254, 10), 0);
}

#[test]
fn the_real_halls_corners_lose_exactly_the_points_that_every_pair_says() {
    let Some(path) = evac_testkit::data("real/livox_mid40_hall_map/corner.pcd") else { return };
    let bytes = std::fs::read(path).unwrap();
    let start = bytes.windows(12).position(|part| part == b"DATA binary\n").unwrap() + 12;
    let points: Vec<[f32; 3]> = bytes[start..]
        .chunks_exact(16)
        .take(15_000)
        .map(|p| std::array::from_fn(|k| f32::from_le_bytes(p[4 * k..4 * k + 4].try_into().unwrap())))
        .collect();
    let outliers = assert_same(&points, 0.3, 4, 2_000);
    assert!(outliers > 100, "{outliers} outliers of {}", points.len());
}
