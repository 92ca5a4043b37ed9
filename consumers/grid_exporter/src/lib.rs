//! Stage `grid_exporter`: from map updates to a flat map that a planner loads and a person reads.
//!
//! Every update goes into voxel columns over the XOY plane, and what it changes is projected at once (paper section 3.1): the
//! cost goes with the update, not with the map. Plans are published on `grid/plan` as they change, and written at a configured
//! interval of sensor time and at the end of the stream, each file whole or not at all:
//!
//! - `plan.pgm` + `plan.yaml` (nav2, `map_server`), and `plan.png` for people;
//! - `plan_ground.pfm`, `plan_step.pfm`: height of the ground, and of the step to it, in metres, in the cells of `plan.yaml`;
//!   NaN where unknown. `plan_ground.png` shows both;
//! - `plan_1.pgm`, `plan_1.yaml` and so on for each further storey, in the order in which they were entered; `storeys.json` lists
//!   them with their heights.
//!
//! Heights count from the local ground, not from the map's origin, see [`GridExporterConfig`]. Storeys are told apart by the heights
//! at which the path is long. Each has its plan, stairs are on both of the storeys that they join, and none changes what another
//! one shows. `grid/plan` is that of the storey on which the sensor is. Space over ground that lies a storey deeper is unknown, not free.

mod columns;
mod config;
mod evidence;
mod files;
mod floor;
mod path;
mod picture;
mod plan;
mod raster;
mod reach;
mod relief;
mod sensor_height;
mod sheet;
mod storeys;
mod surfaces;
mod walk;

use std::fs;

use evac_formats::FormatError;
use evac_formats::occupancy_grid::{self, OccupancyGrid};
use evac_frames::{Ack, FrameHeader, GridHeader, MapHeader, TrackingState, frame_flags, map_flags};
use evac_stage::{
    Counters, Entry, GridOutput, PlanInput, Readiness, Rig, Stage, StageConfig, StageError, State,
};

pub use config::{GridExporterConfig, Mode};

use crate::columns::Columns;
use crate::files::{Saver, StoreyPlan};
use crate::path::Path;
use crate::plan::Projection;
use crate::raster::Raster;
use crate::walk::Walk;

/// The stage.
pub struct GridExporter {
    config: GridExporterConfig,
    columns: Columns,
    path: Path,
    /// What is known since the first map message.
    map: Option<Map>,
    grid: OccupancyGrid,
    saver: Saver,
    published_ns: Option<i64>,
    saved_ns: Option<i64>,
    /// The plan has changed since it was last published, ...
    unpublished: bool,
    /// ... and something came after the last saving.
    unsaved: bool,
    /// A standby's: it has the way from before it came.
    is_loaded: bool,
    /// The newest position of the path, until it is in the journal.
    passed: Option<[f64; 3]>,
}

/// What depends on the map's resolution.
struct Map {
    raster: Raster,
    walk: Walk,
    projection: Projection,
}

impl Stage for GridExporter {
    const NAME: &'static str = "grid_exporter";
    const JOURNALED: bool = true;
    type Config = GridExporterConfig;
    type Input<'a> = PlanInput<'a>;
    type Output = GridOutput;

    fn new(config: Self::Config, _rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        fs::create_dir_all(&config.output_dir)
            .map_err(|cause| file_error(FormatError::writing(&config.output_dir, cause)))?;
        let p = config.occupied_probability;
        let columns = Columns::new(config.max_side_cells, config.max_memory_mib, (p / (1.0 - p)).ln() as f32);
        let grid =
            OccupancyGrid { width: 0, height: 0, resolution: 1.0, origin: [0.0; 3], cells: Vec::new() };
        Ok(Self {
            config,
            columns,
            path: Path::new(),
            map: None,
            grid,
            saver: Saver::default(),
            published_ns: None,
            saved_ns: None,
            unpublished: false,
            unsaved: false,
            is_loaded: false,
            passed: None,
        })
    }

    fn process(
        &mut self,
        input: PlanInput<'_>,
        output: &mut GridOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        self.gather(&input, counters);
        let frame = &input.map.header.frame;
        let end = frame.flags & frame_flags::END_OF_STREAM != 0;
        let publish = is_due(&mut self.published_ns, frame.end_ns, self.config.publish_interval_s);
        if publish && self.unpublished || end {
            self.publish(frame, output)?;
        }
        // A disk that is slower than the interval gets fewer plans.
        let due = self.config.save_interval_s > 0.0 && !self.saver.is_busy();
        if end || due && is_due(&mut self.saved_ns, frame.end_ns, self.config.save_interval_s) {
            self.save()?;
        }
        if end { self.saver.wait().map_err(file_error) } else { Ok(()) }
    }

    /// Gathers the same and neither publishes nor writes.
    fn follow(&mut self, input: PlanInput<'_>, _done: Option<&Ack>) -> Result<Readiness, StageError> {
        self.gather(&input, &mut Counters::default());
        Ok(if self.is_loaded { Readiness::Ready } else { Readiness::Following })
    }

    fn save_state(&self, state: &mut State) {
        self.path.save(state);
    }

    fn load_state(&mut self, state: &mut State, _seq: u64) -> Result<(), StageError> {
        self.load_path(state)?;
        self.is_loaded = true;
        Ok(())
    }

    /// The path; the map is the mapper's, who gives it to whoever asks.
    fn write_down(&mut self, entry: &mut Entry, whole: bool) {
        let passed = self.passed.take();
        if whole {
            entry.added.put(WHOLE_PATH);
            self.path.save(&mut entry.added);
        } else if let Some(position) = passed {
            entry.added.put(POSITION);
            entry.added.put_reals(&position);
        }
    }

    fn read_back(&mut self, entry: &mut Entry) -> Result<(), StageError> {
        while !entry.added.is_at_end() {
            if entry.added.number()? == WHOLE_PATH {
                self.load_path(&mut entry.added)?;
            } else {
                // What was kept once is kept again.
                self.path.push(entry.added.reals()?);
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), StageError> {
        if self.unsaved {
            self.save()?;
        }
        self.saver.wait().map_err(file_error)
    }
}

/// What comes next in the journal.
const POSITION: u64 = 0;
const WHOLE_PATH: u64 = 1;

impl GridExporter {
    fn load_path(&mut self, state: &mut State) -> Result<(), StageError> {
        self.path.load(state)?;
        if let Some(map) = &mut self.map {
            map.walk = Walk::new(map.raster);
            self.path.points().for_each(|position| map.walk.push(position));
        }
        Ok(())
    }

    fn gather(&mut self, input: &PlanInput<'_>, counters: &mut Counters) {
        if self.prepare(input.map.header) {
            let refused = input.map.voxels.iter().filter(|voxel| self.columns.apply(voxel).is_err()).count();
            counters.rejected += refused as u64;
        } else {
            counters.degraded += 1;
        }
        // The path says where a floor is: a lost pose would say it anywhere.
        let lost = matches!(input.pose.tracking_state(), None | Some(TrackingState::Lost));
        if lost || !self.path.push(input.pose.position) {
            counters.degraded += 1;
        } else {
            self.passed = Some(input.pose.position);
            if let Some(map) = &mut self.map {
                map.walk.push(input.pose.position);
            }
        }
        if let Some(Map { walk, projection, .. }) = &mut self.map {
            self.unpublished |= projection.update(&mut self.columns, walk, &self.config);
        }
        self.unsaved = true;
    }

    /// Projects the whole map anew, as if all of it had come with the last update; the plans stay as they are. For comparison
    /// with what following the updates costs.
    pub fn project_anew(&mut self) {
        if let Some(Map { raster, walk, projection }) = &mut self.map {
            *projection = Projection::new(*raster, &self.config);
            projection.update(&mut self.columns, walk, &self.config);
        }
    }

    /// Makes ready for a message; false where its voxels cannot be used.
    fn prepare(&mut self, header: &MapHeader) -> bool {
        let resolution = header.resolution;
        if !(resolution.is_finite() && resolution > 0.0)
            || header.position.iter().any(|axis| !axis.is_finite())
        {
            return false;
        }
        let raster = Raster::new(resolution);
        let snapshot = header.map_flags & map_flags::SNAPSHOT != 0;
        if self.map.is_none() || snapshot {
            let [x, y, _] = header.position;
            self.columns.restart([raster.cell(x), raster.cell(y)]);
            let projection = Projection::new(raster, &self.config);
            let walked = self.map.take().filter(|map| map.raster == raster).map(|map| map.walk);
            let walk = walked.unwrap_or_else(|| {
                let mut walk = Walk::new(raster);
                self.path.points().for_each(|position| walk.push(position));
                walk
            });
            self.map = Some(Map { raster, walk, projection });
        }
        // Updates of another resolution belong to a map whose beginning is not known here.
        self.map.as_ref().is_some_and(|map| map.raster == raster)
    }

    /// Publishes the plan of the storey on which the sensor is.
    fn publish(&mut self, frame: &FrameHeader, output: &mut GridOutput) -> Result<(), StageError> {
        let Some(Map { walk, projection, .. }) = &self.map else { return Ok(()) };
        let storey = projection.storey_at(walk.height().unwrap_or_default());
        if self.columns.is_empty() || !projection.compose(storey, self.config.margin_m, &mut self.grid) {
            return Ok(());
        }
        let grid = &self.grid;
        let [x, y, _] = grid.origin;
        let header = GridHeader {
            frame: *frame,
            resolution: grid.resolution,
            origin: [x, y],
            width: grid.width,
            height: grid.height,
            ..GridHeader::default()
        };
        self.unpublished = false;
        output.publish(&header, |i| grid.cells.get(i).copied().unwrap_or(occupancy_grid::UNKNOWN))
    }

    fn save(&mut self) -> Result<(), StageError> {
        let plans = self.plans();
        self.unsaved = false;
        if plans.is_empty() { Ok(()) } else { self.saver.start(plans, &self.config).map_err(file_error) }
    }

    /// The plans of all storeys of which something is known.
    fn plans(&self) -> Vec<StoreyPlan> {
        let Some(Map { projection, .. }) = self.map.as_ref().filter(|_| !self.columns.is_empty()) else {
            return Vec::new();
        };
        let plan = |storey: usize| {
            let mut grid = self.grid.clone();
            projection.compose(storey, self.config.margin_m, &mut grid).then(|| StoreyPlan {
                ground: projection.ground(storey, &grid),
                route: self.path.route(|height| projection.shows(storey, height)),
                height: projection.height(storey),
                grid,
            })
        };
        (0..projection.storeys()).filter_map(plan).collect()
    }
}

/// Whether `interval_s` of sensor time has passed since the last time this was true (at first: since the first call).
/// Time that runs backwards (a recording that starts again) starts a new interval.
fn is_due(last_ns: &mut Option<i64>, now_ns: i64, interval_s: f64) -> bool {
    let since = last_ns.get_or_insert(now_ns);
    let passed = now_ns.saturating_sub(*since);
    let due = passed >= (interval_s * 1e9) as i64;
    if due || passed < 0 {
        *since = now_ns;
    }
    due
}

fn file_error(error: FormatError) -> StageError {
    StageError::File(error.to_string())
}

#[cfg(test)]
mod tests;
