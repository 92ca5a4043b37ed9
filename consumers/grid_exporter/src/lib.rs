//! Stage `grid_exporter`: from map updates to a flat map that a planner loads and a person reads.
//!
//! Every update goes into voxel columns over the XOY plane; at the configured intervals of sensor time and at the end of
//! the stream they are projected (paper section 3.1), published on `grid/plan` and written as `plan.pgm` + `plan.yaml`
//! (nav2, `map_server`) and `plan.png`.
//!
//! Heights count from the local ground, not from the map's origin, see [`GridExporterConfig`]. There is one plan: that
//! of the storey on which the walk starts, with the ramps and stairs that lead from it up to where they come to lie over
//! it. Another storey that is walked later above or below changes nothing there; where none of the first storey was seen
//! within the path's reach, it is shown. Space over ground that lies a storey deeper is unknown, not free.

mod columns;
mod config;
mod floor;
mod path;
mod picture;
mod plan;

use std::fs;

use evac_formats::FormatError;
use evac_formats::occupancy_grid;
use evac_frames::{FrameHeader, GridHeader, MapHeader, TrackingState, frame_flags, map_flags};
use evac_stage::{Counters, GridOutput, PlanInput, Rig, Stage, StageConfig, StageError};

pub use config::GridExporterConfig;

use crate::columns::Columns;
use crate::floor::cell_of;
use crate::path::Path;
use crate::plan::Projection;

/// The stage.
pub struct GridExporter {
    config: GridExporterConfig,
    columns: Columns,
    path: Path,
    projection: Projection,
    resolution: Option<f64>,
    published_ns: Option<i64>,
    saved_ns: Option<i64>,
    /// Something came after the last saving.
    unsaved: bool,
}

impl Stage for GridExporter {
    const NAME: &'static str = "grid_exporter";
    type Config = GridExporterConfig;
    type Input<'a> = PlanInput<'a>;
    type Output = GridOutput;

    fn new(config: Self::Config, _rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        fs::create_dir_all(&config.output_dir)
            .map_err(|cause| file_error(FormatError::writing(&config.output_dir, cause)))?;
        let p = config.occupied_probability;
        let columns = Columns::new(config.max_side_cells, config.max_memory_mib, (p / (1.0 - p)).ln() as f32);
        Ok(Self {
            config,
            columns,
            path: Path::new(),
            projection: Projection::new(),
            resolution: None,
            published_ns: None,
            saved_ns: None,
            unsaved: false,
        })
    }

    fn process(
        &mut self,
        input: PlanInput<'_>,
        output: &mut GridOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        let frame = &input.map.header.frame;
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
        }
        self.unsaved = true;

        let end = frame.flags & frame_flags::END_OF_STREAM != 0;
        let publish = is_due(&mut self.published_ns, frame.end_ns, self.config.publish_interval_s) || end;
        let save = is_due(&mut self.saved_ns, frame.end_ns, self.config.save_interval_s) || end;
        if (publish || save) && self.project() {
            if publish {
                self.publish(frame, output)?;
            }
            if save {
                self.save()?;
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), StageError> {
        if self.unsaved && self.project() { self.save() } else { Ok(()) }
    }
}

impl GridExporter {
    /// Makes ready for a message; false where its voxels cannot be used.
    fn prepare(&mut self, header: &MapHeader) -> bool {
        let resolution = header.resolution;
        if !(resolution.is_finite() && resolution > 0.0)
            || header.position.iter().any(|axis| !axis.is_finite())
        {
            return false;
        }
        let snapshot = header.map_flags & map_flags::SNAPSHOT != 0;
        if self.resolution.is_none() || snapshot {
            let [x, y, _] = header.position;
            self.columns.restart([cell_of(x, resolution), cell_of(y, resolution)]);
            self.resolution = Some(resolution);
        }
        // Updates of another resolution belong to a map whose beginning is not known here.
        self.resolution == Some(resolution)
    }

    fn project(&mut self) -> bool {
        let Some(resolution) = self.resolution else { return false };
        self.projection.update(&self.columns, &self.path, resolution, &self.config)
    }

    fn publish(&self, frame: &FrameHeader, output: &mut GridOutput) -> Result<(), StageError> {
        let grid = self.projection.grid();
        let [x, y, _] = grid.origin;
        let header = GridHeader {
            frame: *frame,
            resolution: grid.resolution,
            origin: [x, y],
            width: grid.width,
            height: grid.height,
            ..GridHeader::default()
        };
        output.publish(&header, |i| grid.cells.get(i).copied().unwrap_or(occupancy_grid::UNKNOWN))
    }

    fn save(&mut self) -> Result<(), StageError> {
        let grid = self.projection.grid();
        occupancy_grid::write(&self.config.output_dir.join("plan.yaml"), grid).map_err(file_error)?;
        let picture = picture::draw(grid, &self.path, self.config.band_m);
        picture.write_png(&self.config.output_dir.join("plan.png")).map_err(file_error)?;
        self.unsaved = false;
        Ok(())
    }
}

/// Whether `interval_s` of sensor time has passed since the last time this was true (at first: since the first call).
/// Time that runs backwards (a recording that starts again) starts a new interval.
fn is_due(last_ns: &mut Option<i64>, now_ns: i64, interval_s: f64) -> bool {
    let since = last_ns.get_or_insert(now_ns);
    let passed = now_ns.saturating_sub(*since);
    let due = interval_s > 0.0 && passed >= (interval_s * 1e9) as i64;
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
