//! A walk up a stair gives a plan of each storey.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Survey, at, cells, survey};
use evac_formats::occupancy_grid::{FREE, OccupancyGrid};
use evac_formats::pfm;
use evac_simulator::{Config, FRAME_NS, WorldKind};

/// Floor to floor in the simulator's stairwell, metres.
const STOREY_M: f64 = 3.4;

/// Positions of the walk with the height of the floor under them above the first floor.
fn walked(survey: &Survey) -> impl Iterator<Item = ([f64; 2], f64)> {
    (1..=survey.walk.frames() as i64).map(|frame| {
        let place = survey.walk.map_from_lidar(frame * FRAME_NS).translation.vector;
        ([place.x, place.y], place.z)
    })
}

/// Share of the free cells in which truly something stands.
fn blocked(survey: &Survey, grid: &OccupancyGrid, floor: f64) -> f64 {
    let free: Vec<_> = cells(grid).filter(|([x, _], cell)| *cell == FREE && *x < 9.0).collect();
    let blocked = free.iter().filter(|([x, y], _)| survey.stands(*x, *y, floor, [0.3, 1.7], 0.0)).count();
    blocked as f64 / free.len() as f64
}

#[test]
fn a_stairwell_gives_two_plans_with_the_stair_on_both() {
    let survey =
        survey(&Config { world: WorldKind::Stairwell, seed: 5, ..Config::default() }, 0.1, |_, _| {});
    survey.keep("stairs");
    let plans = ["plan.yaml", "plan_1.yaml"].map(|name| survey.plan(name));
    assert!(!survey.path("plan_2.yaml").exists());

    let listing = std::fs::read_to_string(survey.path("storeys.json")).unwrap();
    let above = listing.lines().nth(2).unwrap().split("\"above_first_m\": ").nth(1).unwrap();
    let above: f64 = above.split(',').next().unwrap().parse().unwrap();
    assert!((above - STOREY_M).abs() < 0.15, "{above} m");
    let yaml = std::fs::read_to_string(survey.path("plan_1.yaml")).unwrap();
    assert!(yaml.starts_with("# storey 1: floor at z = "), "{yaml}");

    // What is walked is free: on the lower plan as far as nobody can walk below it, on the upper one from the second step on.
    for ([x, y], height) in walked(&survey) {
        if height < 1.9 {
            assert_eq!(at(&plans[0], x, y), FREE, "lower plan at {x} {y}, {height} m up");
        }
        if height > 0.7 {
            assert_eq!(at(&plans[1], x, y), FREE, "upper plan at {x} {y}, {height} m up");
        }
    }
    for (plan, floor) in plans.iter().zip([survey.floor, survey.floor + STOREY_M]) {
        let share = blocked(&survey, plan, floor);
        println!("{:.2} % of the free cells of the floor at {floor:.2} m are truly blocked", 100.0 * share);
        assert!(share < 0.01, "{share}");
    }

    // The second layer: floors at their heights, and the stair's risers (0.17 m) as steps.
    for (name, plan, floor) in [("plan", &plans[0], 0.0), ("plan_1", &plans[1], STOREY_M)] {
        let read = |layer: &str| pfm::read(&survey.path(&format!("{name}_{layer}.pfm"))).unwrap();
        let ((width, ground), (_, step)) = (read("ground"), read("step"));
        assert_eq!((width, ground.len()), (plan.width, plan.cells.len()));
        let (mut level, mut risers) = (Vec::new(), 0);
        for (([x, y], _), (ground, step)) in cells(plan).zip(ground.iter().zip(&step)) {
            if (4.0..9.0).contains(&x) && y.abs() < 0.9 && ground.is_finite() {
                level.push(f64::from(*ground) - survey.floor - floor);
            }
            risers += usize::from((10.5..12.5).contains(&x) && (0.09..0.21).contains(step));
        }
        level.sort_by(f64::total_cmp);
        let median = level[level.len() / 2];
        assert!(median.abs() < 0.06, "{name}: the floor lies {median} m off");
        assert!(risers > 30, "{name}: {risers} cells with a step");
    }
}

#[test]
fn a_building_with_ramps_and_one_on_one_floor_are_one_storey() {
    for (world, building) in [(WorldKind::Ramp, 1), (WorldKind::FloorPlan, 3)] {
        let survey = survey(&Config { world, building, seed: 3, ..Config::default() }, 0.1, |_, _| {});
        survey.keep("ramp");
        assert!(survey.path("plan.yaml").exists() && !survey.path("plan_1.yaml").exists(), "{world:?}");
        let plan = survey.plan("plan.yaml");
        let free = walked(&survey).filter(|([x, y], _)| at(&plan, *x, *y) == FREE).count();
        assert_eq!(free, survey.walk.frames() as usize, "{world:?}: the whole path is free");
    }
}
