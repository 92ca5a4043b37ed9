//! What path and voxels say about one cell (paper sections 3.1 and 3.2 step 3): non-ground voxels of a height band over the local
//! ground make it occupied; seen ground, space seen through down to near the floor, or having been walked on make it free.

use crate::GridExporterConfig;
use crate::columns::{Column, Kind};
use crate::raster::Raster;

/// Rounding of a height computed from voxel indices, metres.
const ROUNDING_M: f64 = 1e-6;
/// Space seen this far below the floor is a hole in it, metres: more than a riser, and than the heights of one floor differ
/// between two walks over it.
const DROP_M: f64 = 0.3;
/// How far down such space is looked for, metres: rays that pass over an edge leave some of it close below.
const DROP_DEPTH_M: f64 = 1.5;
/// What is lower than this on a stair that was climbed was stepped on, metres: a riser and the slope below its tread.
const STEPPED_OVER_M: f64 = 0.4;

/// What the path says about a cell.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Footing {
    /// Height of the floor, metres.
    pub(crate) floor: f64,
    /// Whether the path passes.
    pub(crate) walked: bool,
    /// Whether it climbs as it passes, here or right beside.
    pub(crate) climbed: bool,
}

/// What path and voxels say together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Evidence {
    /// Occupied voxels in the band.
    pub(crate) occupied: u8,
    /// Whether a person could stand here if nothing is in the way.
    pub(crate) open: bool,
    /// Height of what one stands on, metres; NaN where nothing was seen or trodden on.
    pub(crate) ground: f32,
}

/// Adds what a column says to what the path has said.
pub(crate) fn weigh(
    column: Column<'_>,
    footing: Footing,
    raster: Raster,
    config: &GridExporterConfig,
) -> Evidence {
    if let Some(heights) = config.fixed_z_m {
        return between(column, heights, raster);
    }
    let Footing { floor, walked, climbed } = footing;
    // Voxels whose centres lie between.
    let voxels = |low: f64, high: f64| {
        let first = ((floor + low - ROUNDING_M) / raster.resolution - 0.5).ceil() as i32;
        let last = ((floor + high + ROUNDING_M) / raster.resolution - 0.5).floor() as i32;
        (first, last)
    };
    let count = |kind: Kind, low: f64, high: f64| {
        let (first, last) = voxels(low, high);
        column.count(kind, first, last)
    };
    let [low, high] = config.band_m;
    let (mut grounds, mut sum, mut deeper, mut raised) = (0_u32, 0.0, false, 0);
    column.for_each_ground(|cell| {
        let height = raster.centre(cell);
        let above = height - floor;
        if above.abs() <= config.max_step_m {
            grounds += 1;
            sum += height;
        }
        deeper |= above < -config.max_step_m;
        // A top that is too high to step on, however even it is.
        raised += u32::from(above > config.max_step_m && (low..=high).contains(&above));
    });
    // Space that was seen down to near the floor, and no farther: there is none over a gallery's void, a platform's
    // edge or a stair that leads down, and what is seen over a table says nothing of what is below.
    let seen_through = || {
        // Coarse voxels: at least one, and no more than there are; the floor's own one is no hole.
        let near_floor = config.seen_down_to_m.max(low + raster.resolution);
        let voxels = ((near_floor - low + ROUNDING_M) / raster.resolution) as u32;
        count(Kind::Free, low, near_floor) >= config.min_free_voxels.min(voxels)
            && !deeper
            && count(Kind::Free, -DROP_DEPTH_M, -DROP_M.max(raster.resolution)) == 0
    };
    // On a stair that was climbed the next step is no obstacle.
    let low = if climbed { low.max(STEPPED_OVER_M) } else { low };
    let occupied = count(Kind::Occupied, low, high) + raised;
    let tread = || {
        let (first, last) = voxels(-STEPPED_OVER_M, STEPPED_OVER_M);
        column.highest(Kind::Occupied, first, last).filter(|_| climbed).map(|cell| raster.centre(cell))
    };
    let ground = match grounds {
        0 => tread().or(walked.then_some(floor)).unwrap_or(f64::NAN),
        _ => sum / f64::from(grounds),
    };
    Evidence {
        occupied: occupied.min(u32::from(u8::MAX)) as u8,
        open: walked || grounds > 0 || seen_through(),
        ground: ground as f32,
    }
}

/// What a column says by `octomap_server`'s rules: every voxel whose cube reaches between two heights in the map frame counts.
fn between(column: Column<'_>, [low, high]: [f64; 2], raster: Raster) -> Evidence {
    let first = (low / raster.resolution).floor() as i32;
    let last = (high / raster.resolution).ceil() as i32 - 1;
    let count = |kind: Kind| column.count(kind, first, last);
    let occupied = count(Kind::Occupied).min(u32::from(u8::MAX)) as u8;
    Evidence { occupied, open: count(Kind::Free) > 0, ground: f32::NAN }
}
