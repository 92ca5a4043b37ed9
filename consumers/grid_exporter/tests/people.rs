//! A hall in which people walk leaves no trail of them in the plan.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Survey, cells, survey};
use evac_formats::occupancy_grid::{FREE, OCCUPIED};
use evac_simulator::{Config, WorldKind};

/// A cell is explained by what stands within this distance of its centre, metres: half its diagonal, range noise of three sigma.
const MARGIN_M: f64 = 0.13;

/// Occupied cells that neither wall nor object explains, as a share of the free cells.
fn unexplained(survey: &Survey) -> f64 {
    let grid = survey.plan("plan.yaml");
    let count = |state: i8| cells(&grid).filter(move |(_, cell)| *cell == state);
    let ghosts = count(OCCUPIED)
        .filter(|([x, y], _)| !survey.stands(*x, *y, survey.floor, [0.05, 1.95], MARGIN_M))
        .inspect(|([x, y], _)| println!("ghost {x:.2} {y:.2}"))
        .count();
    let free = count(FREE).count();
    println!("{ghosts} occupied cells that nothing explains, {free} free ones");
    ghosts as f64 / free as f64
}

#[test]
fn six_people_who_walk_about_a_station_hall_leave_no_trail() {
    let survey = survey(&Config { world: WorldKind::Hall, seed: 5, ..Config::default() }, 0.1, |_, _| {});
    survey.keep("hall");
    let share = unexplained(&survey);
    assert!(share < 0.005, "{:.2} % of the free cells", 100.0 * share);
}
