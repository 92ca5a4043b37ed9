//! A projection that follows updates against one that is made at once.

use evac_formats::occupancy_grid::{FREE, OCCUPIED, UNKNOWN};
use evac_frames::{Voxel, voxel_flags};
use proptest::prelude::*;

use super::*;

const RESOLUTION: f64 = 0.1;

/// What can happen to a map.
#[derive(Debug, Clone)]
enum Event {
    /// A box of voxels from a corner, by size, with the flags of each, occupied or not.
    Voxels { corner: [i32; 3], size: [i32; 3], flags: u16, log_odds: f32 },
    /// A straight walk.
    Walk { from: [f64; 3], to: [f64; 3] },
    /// Everything is projected.
    Update,
}

/// Heights that matter: a floor, a step, a table, a storey above, and what lies between.
fn height() -> impl Strategy<Value = i32> {
    prop_oneof![Just(-12), Just(-9), Just(-4), Just(20), -15i32..40]
}

fn event() -> impl Strategy<Value = Event> {
    let ground = voxel_flags::GROUND | voxel_flags::KNOWN;
    let flags = prop_oneof![4 => Just(ground), 4 => Just(voxel_flags::KNOWN), 1 => Just(voxel_flags::GROUND), 1 => Just(0)];
    let voxels = (
        (-30i32..30, -30i32..30, height()).prop_map(|(x, y, z)| [x, y, z]),
        (1i32..25, 1i32..25, prop_oneof![3 => Just(1), 1 => 1i32..20]).prop_map(|(x, y, z)| [x, y, z]),
        flags,
        prop_oneof![Just(-1.0_f32), Just(1.0)],
    );
    let place = || (-3.0..3.0, -3.0..3.0, prop_oneof![Just(0.0), Just(0.04), Just(3.2), -0.5..3.5]);
    let walk = (place(), place());
    prop_oneof![
        4 => voxels.prop_map(|(corner, size, flags, log_odds)| Event::Voxels { corner, size, flags, log_odds }),
        2 => walk.prop_map(|(from, to)| Event::Walk { from: from.into(), to: to.into() }),
        2 => Just(Event::Update),
    ]
}

fn happen(event: &Event, columns: &mut Columns, walk: &mut Walk) {
    match event {
        Event::Voxels { corner, size: [w, d, h], flags, log_odds } => {
            for (x, y, z) in (0..*w).flat_map(|x| (0..*d).flat_map(move |y| (0..*h).map(move |z| (x, y, z))))
            {
                let [x0, y0, z0] = corner;
                let key = [x + x0, y + y0, z + z0].map(|axis| (axis + 32_768) as u16);
                let voxel = Voxel { key, flags: *flags, log_odds: *log_odds };
                columns.apply(&voxel).unwrap();
            }
        }
        Event::Walk { from, to } => {
            for i in 0..=60 {
                let share = f64::from(i) / 60.0;
                walk.push([0, 1, 2].map(|axis: usize| from[axis] + (to[axis] - from[axis]) * share));
            }
        }
        Event::Update => {}
    }
}

/// All plans with their ground.
fn plans(projection: &Projection) -> Vec<(OccupancyGrid, Vec<u32>)> {
    let one = |storey: usize| {
        let mut grid =
            OccupancyGrid { width: 0, height: 0, resolution: 1.0, origin: [0.0; 3], cells: Vec::new() };
        projection.compose(storey, 0.5, &mut grid);
        let ground = projection.ground(storey, &grid).iter().map(|height| height.to_bits()).collect();
        (grid, ground)
    };
    (0..projection.storeys()).map(one).collect()
}

fn check(events: &[Event], config: &GridExporterConfig) -> Result<usize, TestCaseError> {
    let raster = Raster::new(RESOLUTION);
    let (mut columns, mut walk) = (Columns::new(1000, 16, 0.0), Walk::new(raster));
    let mut followed = Projection::new(raster, config);
    for event in events {
        happen(event, &mut columns, &mut walk);
        if matches!(event, Event::Update) {
            followed.update(&mut columns, &mut walk, config);
        }
    }
    followed.update(&mut columns, &mut walk, config);
    let mut anew = Projection::new(raster, config);
    anew.update(&mut columns, &mut walk, config);
    prop_assert_eq!(followed.sensor_height, anew.sensor_height);
    prop_assert!(plans(&followed) == plans(&anew), "plans differ");
    prop_assert!(!followed.update(&mut columns, &mut walk, config), "nothing has happened");
    Ok(anew.storeys())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn a_projection_that_follows_any_updates_equals_one_made_at_once(
        events in proptest::collection::vec(event(), 1..40),
    ) {
        check(&events, &GridExporterConfig::default())?;
    }
}

#[test]
fn what_is_compared_has_storeys_obstacles_and_free_space() {
    let voxels = |corner, size, flags, log_odds| Event::Voxels { corner, size, flags, log_odds };
    let mut events = Vec::new();
    for (z, path) in [(-12, 0.0), (20, 3.2)] {
        let ground = voxel_flags::GROUND | voxel_flags::KNOWN;
        events.push(voxels([-30, -30, z], [60, 60, 1], ground, -1.0));
        events.push(voxels([10, -30, z], [2, 60, 15], voxel_flags::KNOWN, 1.0));
        for y in 0..4 {
            let y = f64::from(y) * 0.5;
            events.push(Event::Walk { from: [-2.5, y, path], to: [0.5, y, path] });
            events.push(Event::Update);
        }
    }
    assert_eq!(check(&events, &GridExporterConfig::default()).unwrap(), 2);
}

proptest! {
    #[test]
    fn between_fixed_heights_cells_are_what_octomap_server_makes_of_them(
        voxels in proptest::collection::hash_map((0i32..12, 0i32..12, -8i32..8), any::<bool>(), 1..150),
        low in -0.9..0.5,
        span in 0.01..0.9,
    ) {
        let config = GridExporterConfig { fixed_z_m: Some([low, low + span]), margin_m: 0.0, ..Default::default() };
        let (mut columns, mut walk) = (Columns::new(1000, 16, 0.0), Walk::new(Raster::new(RESOLUTION)));
        let mut projection = Projection::new(Raster::new(RESOLUTION), &config);
        walk.push([0.5, 0.5, 0.0]);
        for ((x, y, z), occupied) in &voxels {
            let key = [*x, *y, *z].map(|axis| (axis + 32_768) as u16);
            let log_odds = if *occupied { 1.0 } else { -1.0 };
            columns.apply(&Voxel { key, flags: voxel_flags::KNOWN, log_odds }).unwrap();
            projection.update(&mut columns, &mut walk, &config);
        }
        // The rule as octomap_server states it, leaf by leaf.
        let mut expected = vec![UNKNOWN; 144];
        for ((x, y, z), occupied) in &voxels {
            let (centre, half) = ((f64::from(*z) + 0.5) * RESOLUTION, RESOLUTION / 2.0);
            if centre + half > low && centre - half < low + span {
                let cell = &mut expected[(y * 12 + x) as usize];
                *cell = if *occupied || *cell == OCCUPIED { OCCUPIED } else { FREE };
            }
        }
        let mut grid = OccupancyGrid { width: 0, height: 0, resolution: 1.0, origin: [0.0; 3], cells: Vec::new() };
        let known = projection.compose(0, 0.0, &mut grid);
        prop_assert_eq!(known, expected.iter().any(|cell| *cell != UNKNOWN));
        for (place, cell) in expected.iter().enumerate().filter(|_| known) {
            let [x, y] = [0, 1].map(|axis: usize| {
                let place = if axis == 0 { place % 12 } else { place / 12 };
                place as i64 - (grid.origin[axis] / RESOLUTION).round() as i64
            });
            let inside = (0..i64::from(grid.width)).contains(&x) && (0..i64::from(grid.height)).contains(&y);
            let is = if inside { grid.cells[(y * i64::from(grid.width) + x) as usize] } else { UNKNOWN };
            prop_assert_eq!(is, *cell, "cell {}", place);
        }
    }
}
