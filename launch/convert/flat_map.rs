//! A flat map of a finished map without a path: obstacles in a band over the local ground of one storey.

use std::collections::VecDeque;

use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};
use evac_formats::rgb_image::RgbImage;
use evac_frames::voxel_flags;
use evac_octree::OctreeMap;

use super::output::is_occupied;
use crate::error::LaunchError;

/// Largest step between the ground of neighbouring cells that is one storey, metres; as the grid exporter has it.
const STEP_M: f64 = 0.4;
/// How far beside seen ground its height is taken for that of walls, and over gaps, metres.
const BESIDE_M: f64 = 0.5;
/// Heights in which the storey with most ground is looked for, metres.
const LEVEL_M: f64 = 0.25;
/// Most cells of a flat map: 16,384 squared.
const MOST_CELLS: u64 = 1 << 28;
/// The picture's longer side is at least this long, pixels.
const PICTURE_PIXELS: u32 = 1200;

/// What to show.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlatMap {
    /// Heights above the ground, metres.
    pub(crate) band: [f64; 2],
    /// Height of the storey, metres; `None` is the one with most ground.
    pub(crate) storey: Option<f64>,
}

/// A voxel as its cell and its height.
type Placed = (u32, u16);

/// Projects the map. Ground is where voxels have the ground flag.
pub(crate) fn project(map: &OctreeMap, flat: &FlatMap) -> Result<OccupancyGrid, LaunchError> {
    let (mut low, mut high) = ([u16::MAX; 2], [0; 2]);
    for voxel in map.voxels() {
        for axis in 0..2 {
            low[axis] = voxel.key[axis].min(low[axis]);
            high[axis] = voxel.key[axis].max(high[axis]);
        }
    }
    let [width, height] = [0, 1].map(|axis| u32::from(high[axis]).saturating_sub(low[axis].into()) + 1);
    if map.voxel_count() == 0 || u64::from(width) * u64::from(height) > MOST_CELLS {
        return Err(LaunchError::Silent(format!(
            "a flat map of {width} x {height} cells cannot be drawn; give other limits of x and y, or a coarser --resolution"
        )));
    }
    let resolution = map.space().resolution();
    let (mut ground, mut occupied): (Vec<Placed>, Vec<Placed>) = (Vec::new(), Vec::new());
    for voxel in map.voxels() {
        let [x, y, z] = voxel.key;
        let cell = u32::from(y - low[1]) * width + u32::from(x - low[0]);
        if voxel.flags & voxel_flags::GROUND != 0 {
            ground.push((cell, z));
        }
        if is_occupied(map, &voxel) {
            occupied.push((cell, z));
        }
    }
    ground.sort_unstable();
    let height_of = |z: u16| map.space().centre([0, 0, z])[2];
    let levels = levels(&ground, [width, height], resolution, flat.storey, height_of);
    let mut cells = vec![UNKNOWN; width as usize * height as usize];
    for (cell, z) in ground {
        let on_storey = levels[cell as usize].is_some_and(|level| (height_of(z) - level).abs() < resolution);
        if on_storey {
            cells[cell as usize] = FREE;
        }
    }
    let [least, most] = flat.band;
    for (cell, z) in occupied {
        let above = levels[cell as usize].map(|level| height_of(z) - level);
        if above.is_some_and(|above| (least..=most).contains(&above)) {
            cells[cell as usize] = OCCUPIED;
        }
    }
    let [x, y, _] = map.space().centre([low[0], low[1], 0]);
    let origin = [x - 0.5 * resolution, y - 0.5 * resolution, 0.0];
    Ok(OccupancyGrid { width, height, resolution, origin, cells })
}

/// The height of the storey's ground by cell: spreads from all ground near the storey's height to what continues it.
fn levels(
    ground: &[Placed],
    [width, height]: [u32; 2],
    resolution: f64,
    storey: Option<f64>,
    height_of: impl Fn(u16) -> f64,
) -> Vec<Option<f64>> {
    let mut levels = vec![None; width as usize * height as usize];
    let Some(main) = storey.or_else(|| most_ground(ground, &height_of)) else { return levels };
    // The ground of a cell that is nearest to a height, within a step.
    let nearest = |cell: u32, level: f64| {
        let from = ground.partition_point(|(other, _)| *other < cell);
        let own = ground[from..].iter().take_while(|(other, _)| *other == cell).map(|(_, z)| height_of(*z));
        let near = own.min_by(|a, b| (a - level).abs().total_cmp(&(b - level).abs()));
        near.filter(|height| (height - level).abs() <= STEP_M)
    };
    let mut queue = VecDeque::new();
    for run in ground.chunk_by(|(a, _), (b, _)| a == b) {
        if let Some(level) = run.first().and_then(|(cell, _)| nearest(*cell, main)) {
            levels[run[0].0 as usize] = Some(level);
            // Steps that were bridged without seen ground since.
            queue.push_back((run[0].0, level, 0));
        }
    }
    let bridged = (BESIDE_M / resolution).ceil() as u32;
    while let Some((cell, level, gap)) = queue.pop_front() {
        let (x, y) = (cell % width, cell / width);
        let around = [
            (x > 0).then(|| cell - 1),
            (x + 1 < width).then_some(cell + 1),
            (y > 0).then(|| cell - width),
            (y + 1 < height).then_some(cell + width),
        ];
        for next in around.into_iter().flatten() {
            if levels[next as usize].is_some() {
                continue;
            }
            match nearest(next, level) {
                Some(level) => queue.push_back((next, level, 0)),
                None if gap < bridged => queue.push_back((next, level, gap + 1)),
                None => continue,
            }
            levels[next as usize] = queue.back().map(|(_, level, _)| *level);
        }
    }
    levels
}

/// The middle of the heights at which most ground lies.
fn most_ground(ground: &[Placed], height_of: impl Fn(u16) -> f64) -> Option<f64> {
    let mut histogram = std::collections::BTreeMap::new();
    for (_, z) in ground {
        *histogram.entry((height_of(*z) / LEVEL_M).floor() as i64).or_insert(0_u64) += 1;
    }
    let (level, _) = histogram.into_iter().max_by_key(|(_, count)| *count)?;
    Some((level as f64 + 0.5) * LEVEL_M)
}

/// The flat map as a picture: walls dark, free space white, what is unknown grey.
pub(crate) fn picture(grid: &OccupancyGrid) -> RgbImage {
    let scale = PICTURE_PIXELS.div_ceil(grid.width.max(grid.height)).min(8);
    let mut image = RgbImage::new(grid.width * scale, grid.height * scale, [200, 202, 206]);
    for (index, cell) in grid.cells.iter().enumerate() {
        let colour = match *cell {
            OCCUPIED => [24, 24, 28],
            FREE => [255, 255, 255],
            _ => continue,
        };
        let (x, y) =
            (index as u32 % grid.width * scale, (grid.height - 1 - index as u32 / grid.width) * scale);
        for (dx, dy) in (0..scale).flat_map(|dy| (0..scale).map(move |dx| (dx, dy))) {
            image.set(i64::from(x + dx), i64::from(y + dy), colour);
        }
    }
    image
}
