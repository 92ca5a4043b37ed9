//! The files, written by a thread of their own so that no frame waits for a disk.

use std::io::Write as _;
use std::path::Path;
use std::thread::{self, JoinHandle};

use evac_formats::occupancy_grid::{self, FREE, OccupancyGrid};
use evac_formats::{FormatError, pfm, write_atomically};

use crate::GridExporterConfig;
use crate::path::Route;
use crate::picture;
use crate::relief::Relief;

/// One storey as it is saved.
pub(crate) struct StoreyPlan {
    pub(crate) grid: OccupancyGrid,
    /// See [`Relief`]; metres.
    pub(crate) ground: Vec<f32>,
    pub(crate) route: Route,
    /// Height of its floor in the map frame, metres.
    pub(crate) height: f64,
}

/// Writes plans to the disk, one after the other.
#[derive(Default)]
pub(crate) struct Saver {
    writing: Option<JoinHandle<Result<(), FormatError>>>,
    /// Most storeys that were saved.
    storeys: usize,
}

impl Saver {
    /// Whether the last plans are still being written.
    pub(crate) fn is_busy(&self) -> bool {
        self.writing.as_ref().is_some_and(|writing| !writing.is_finished())
    }

    /// Writes the plans of all storeys beside what goes on, after those before.
    ///
    /// # Errors
    /// What went wrong with those before.
    pub(crate) fn start(
        &mut self,
        plans: Vec<StoreyPlan>,
        config: &GridExporterConfig,
    ) -> Result<(), FormatError> {
        self.wait()?;
        let (config, before) = (config.clone(), self.storeys);
        self.storeys = self.storeys.max(plans.len());
        self.writing = Some(thread::spawn(move || write(&plans, before, &config)));
        Ok(())
    }

    /// Waits until all is written.
    ///
    /// # Errors
    /// What went wrong.
    pub(crate) fn wait(&mut self) -> Result<(), FormatError> {
        let Some(writing) = self.writing.take() else { return Ok(()) };
        writing.join().unwrap_or_else(|_| {
            let cause = std::io::Error::other("the thread that writes the plans has ended early");
            Err(FormatError::writing(Path::new("plan.yaml"), cause))
        })
    }
}

/// Name of a storey's files without ending: `plan` for the first one, `plan_1`, `plan_2` for others.
pub(crate) fn name(storey: usize) -> String {
    if storey == 0 { "plan".to_owned() } else { format!("plan_{storey}") }
}

/// Writes all files; `before`: how many storeys were written the last time.
fn write(plans: &[StoreyPlan], before: usize, config: &GridExporterConfig) -> Result<(), FormatError> {
    let path = |name: String| config.output_dir.join(name);
    let first = plans.first().map_or(0.0, |plan| plan.height);
    for (plan, number) in plans.iter().zip(0..) {
        let StoreyPlan { grid, ground, route, height } = plan;
        let (name, above) = (name(number), height - first);
        let comment =
            format!("storey {number}: floor at z = {height:.2} m, {above:+.2} m from the first storey's");
        occupancy_grid::write_as(&path(format!("{name}.yaml")), grid, config.mode.into(), &[&comment])?;
        let title = if plans.len() > 1 { format!("storey {number}, {above:+.1} m") } else { String::new() };
        picture::plan(grid, route, config.band_m, &title).write_png(&path(format!("{name}.png")))?;
        let relief = Relief::new(grid, ground.clone());
        pfm::write(&path(format!("{name}_ground.pfm")), grid.width, &relief.ground)?;
        pfm::write(&path(format!("{name}_step.pfm")), grid.width, &relief.step)?;
        picture::ground(grid, &relief, &title).write_png(&path(format!("{name}_ground.png")))?;
    }
    write_atomically(&path("storeys.json".to_owned()), |writer| writer.write_all(listing(plans).as_bytes()))?;
    // A storey that has turned out to be none leaves no plan behind.
    for gone in plans.len()..before {
        for ending in [".yaml", ".pgm", "_scale.png", ".png", "_ground.pfm", "_step.pfm", "_ground.png"] {
            let path = path(format!("{}{ending}", name(gone)));
            match std::fs::remove_file(&path) {
                Err(cause) if cause.kind() != std::io::ErrorKind::NotFound => {
                    return Err(FormatError::writing(&path, cause));
                }
                _ => {}
            }
        }
    }
    Ok(())
}

/// `storeys.json`: which plans there are, and how high.
fn listing(plans: &[StoreyPlan]) -> String {
    let first = plans.first().map_or(0.0, |plan| plan.height);
    let one = |(plan, number): (&StoreyPlan, usize)| {
        let free = plan.grid.cells.iter().filter(|cell| **cell == FREE).count() as f64;
        format!(
            "  {{\"plan\": \"{}.yaml\", \"floor_z_m\": {:.3}, \"above_first_m\": {:.3}, \"free_m2\": {:.1}}}",
            name(number),
            plan.height,
            plan.height - first,
            free * plan.grid.resolution * plan.grid.resolution
        )
    };
    let all: Vec<String> = plans.iter().zip(0..).map(one).collect();
    format!("[\n{}\n]\n", all.join(",\n"))
}
