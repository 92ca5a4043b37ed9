use proptest::prelude::*;

use super::*;

fn voxel(x: i32, y: i32, z: i32, log_odds: f32, flags: u16) -> Voxel {
    Voxel { key: [x, y, z].map(|cell| (cell + ZERO_KEY) as u16), flags, log_odds }
}

#[test]
fn a_voxel_seen_through_later_is_no_longer_occupied() {
    let mut columns = Columns::new(100, 1, 0.0);
    columns.apply(&voxel(-1, 2, -5, 0.5, voxel_flags::KNOWN)).unwrap();
    assert_eq!(columns.column([-1, 2]).count(Kind::Occupied, -5, -5), 1);
    columns.apply(&voxel(-1, 2, -5, -0.5, voxel_flags::KNOWN)).unwrap();
    assert_eq!(columns.column([-1, 2]).count(Kind::Occupied, -100, 100), 0);
    assert_eq!(columns.column([-1, 2]).count(Kind::Free, -100, 100), 1);
    assert_eq!(columns.column([-2, 2]).count(Kind::Free, -100, 100), 0);
}

#[test]
fn a_ground_voxel_without_a_value_says_nothing_of_occupancy() {
    let mut columns = Columns::new(100, 1, 0.0);
    columns.apply(&voxel(0, 0, 0, 0.0, voxel_flags::GROUND)).unwrap();
    let column = columns.column([0, 0]);
    assert_eq!([Kind::Ground, Kind::Occupied, Kind::Free].map(|kind| column.count(kind, 0, 0)), [1, 0, 0]);
}

#[test]
fn voxels_beyond_the_side_or_the_memory_are_refused() {
    let mut columns = Columns::new(100, 1, 0.0);
    columns.restart([1000, 0]);
    assert_eq!(columns.apply(&voxel(0, 0, 0, 1.0, voxel_flags::KNOWN)), Err(Refused));
    assert_eq!(columns.apply(&voxel(1049, 0, 0, 1.0, voxel_flags::KNOWN)), Ok(()));
    assert_eq!(columns.apply(&voxel(1050, 0, 0, 1.0, voxel_flags::KNOWN)), Err(Refused));
    assert_eq!(columns.apply(&voxel(1000, 0, 0, f32::NAN, voxel_flags::KNOWN)), Err(Refused));
    // A layer takes 1.5 KiB: more than 600 and less than 700 fit one MiB.
    let taken = (-50..50).flat_map(|x| (-10..10).map(move |chunk| (x, chunk))).filter(|(x, chunk)| {
        columns.apply(&voxel(1000 + x, 8 * x.rem_euclid(5), chunk * 64, 1.0, voxel_flags::KNOWN)).is_ok()
    });
    assert!(taken.count() < 2000);
    assert_eq!(columns.layers, columns.max_layers);
    assert!(columns.tiles.values().all(|tile| !tile.layers.is_empty()), "what was refused leaves nothing");
    assert!((600..700).contains(&columns.layers));
}

proptest! {
    #[test]
    fn counting_by_masks_equals_counting_one_by_one(
        heights in proptest::collection::btree_set(-200i32..200, 0..60),
        low in -220i32..220,
        size in 0i32..200,
    ) {
        let mut columns = Columns::new(100, 1, 0.0);
        for z in &heights {
            columns.apply(&voxel(3, -4, *z, 1.0, voxel_flags::KNOWN | voxel_flags::GROUND)).unwrap();
        }
        let expected = heights.iter().filter(|z| (low..=low + size).contains(*z)).count();
        prop_assert_eq!(columns.column([3, -4]).count(Kind::Occupied, low, low + size), expected as u32);
        let mut ground = Vec::new();
        columns.column([3, -4]).for_each_ground(|z| ground.push(z));
        ground.sort_unstable();
        prop_assert_eq!(ground, heights.into_iter().collect::<Vec<_>>());
    }
}
