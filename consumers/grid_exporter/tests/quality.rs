//! Plans of simulated buildings against what the buildings truly look like.
#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeMap;

use common::{Survey, cells, survey};
use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid};
use evac_simulator::{Config, WorldKind};

/// What a person would bump into: the exporter's default.
const BAND_M: [f64; 2] = [0.2, 1.8];

/// Free space of plan and building where at least two shots ended: intersection over union.
fn iou_of_free_space(survey: &Survey, grid: &OccupancyGrid) -> f64 {
    let (mut both, mut either) = (0_u32, 0_u32);
    for ([x, y], cell) in cells(grid) {
        let place = [x, y].map(|axis| (axis / grid.resolution).floor() as i64);
        if survey.seen.get(&place).is_none_or(|shots| *shots < 2) {
            continue;
        }
        let truly_free = !survey.stands(x, y, survey.floor, BAND_M, 0.0);
        both += u32::from(cell == FREE && truly_free);
        either += u32::from(cell == FREE || truly_free);
    }
    f64::from(both) / f64::from(either)
}

/// Median thickness of what is occupied in cells, where each place along a wall counts once: a cell that is one of three side by
/// side, along x or y, whichever are fewer, counts a third.
fn thickness(grid: &OccupancyGrid) -> usize {
    let (width, height) = (i64::from(grid.width), i64::from(grid.height));
    let occupied = |x: i64, y: i64| {
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        inside && grid.cells[(y * width + x) as usize] == OCCUPIED
    };
    let run =
        |x: i64, y: i64, dx: i64, dy: i64| (1..).take_while(|i| occupied(x + dx * i, y + dy * i)).count();
    let mut cells = BTreeMap::new();
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|(x, y)| occupied(*x, *y))
    {
        let along = [[1, 0], [0, 1]].map(|[dx, dy]| 1 + run(x, y, dx, dy) + run(x, y, -dx, -dy));
        *cells.entry(along[0].min(along[1])).or_insert(0.0) += 1.0;
    }
    let places = |(thick, cells): (&usize, &f64)| (*thick, cells / *thick as f64);
    let half = cells.iter().map(places).map(|(_, places)| places).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    let median = cells.iter().map(places).find(|(_, places)| {
        sum += places;
        sum >= half
    });
    median.unwrap().0
}

fn check(name: &str, world: &Config) {
    let survey = survey(world, 0.05, |_, _| {});
    let grid = survey.plan("plan.yaml");
    survey.keep(name);
    let (iou, thickness) = (iou_of_free_space(&survey, &grid), thickness(&grid));
    println!("{name}: IoU of free space {iou:.3}, walls {thickness} cells thick");
    assert!(iou >= 0.92, "{name}: IoU {iou}");
    assert!(thickness <= 2, "{name}: {thickness} cells");
}

#[test]
fn a_basement_corridor_overlaps_its_true_outline_with_thin_walls() {
    check("corridor", &Config::default());
}

#[test]
fn buildings_drawn_from_numbers_overlap_their_true_outline_with_thin_walls() {
    for building in [2, 7] {
        check(
            &format!("plan_{building}"),
            &Config { world: WorldKind::FloorPlan, building, seed: building, ..Config::default() },
        );
    }
}
