//! Ground filter (paper section 3.1, filter 3): large contiguous surfaces, low and of small tilt.

mod columns;
mod moments;
mod patch;
mod surfaces;

use std::collections::VecDeque;

use moments::Plane;
use patch::Patch;
use surfaces::{NONE, Surface, Surfaces};

use evac_stage::{StageError, State};

use crate::GroundConfig;

pub(crate) use columns::{CloudGround, GroundColumns};

/// Patches of earlier scans that are remembered.
const MEMORY: usize = 16;

/// Finds the ground points of a cloud in a frame whose z is against gravity, on any number of levels.
///
/// The xy plane is divided into cells. In each cell the lowest slab of points above a gap is a surface; planes through
/// 3 x 3 cells tell horizontal surfaces; those that continue each other form patches; a patch is ground by its tilt,
/// its extent both ways, its height below the sensor, and for not being a table top. The tread of a stair fails by
/// extent, a wall's foot by tilt. Points within the thickness of a ground's local plane are ground, so what
/// stands on it keeps all but its lowest centimetres.
///
/// With a sensor position (one scan) the surfaces of a floor thin out with range and a corner shows only a strip
/// of it. There lowest surfaces that continue the plane of a patch, of this scan or of one of the last
/// ones, up to one length of the patch beyond it are ground too. Without a sensor position (a whole cloud) floors are
/// told from ceilings by the room above. What no cloud tells: the roof of a train or a kiosk larger than furniture is a
/// level like any platform.
#[derive(Debug)]
pub struct GroundFilter {
    config: GroundConfig,
    surfaces: Surfaces,
    patches: Vec<Patch>,
    stack: Vec<u32>,
    /// Plane and length of ground seen lately, newest last.
    known: VecDeque<(Plane, f64)>,
    /// The ground's plane of each surface.
    planes: Vec<Option<Plane>>,
    ground: Vec<bool>,
}

impl GroundFilter {
    /// A filter whose buffers hold `capacity` points before they grow.
    pub fn new(config: GroundConfig, capacity: usize) -> Self {
        Self {
            config,
            surfaces: Surfaces::with_capacity(capacity),
            patches: Vec::with_capacity(capacity),
            stack: Vec::with_capacity(capacity),
            known: VecDeque::with_capacity(MEMORY + 1),
            planes: Vec::with_capacity(capacity),
            ground: Vec::with_capacity(capacity),
        }
    }

    /// One flag a point of a scan: whether it is ground. `sensor` is where it was seen from, in the same frame, metres.
    pub fn ground_of_scan(&mut self, points: &[[f32; 3]], sensor: [f64; 3]) -> &[bool] {
        self.find_patches(points, sensor);
        if self.config.enabled {
            self.remember();
            self.extend();
            self.mark(points);
        }
        &self.ground
    }

    /// Whether what is remembered of earlier scans is all that ever will be: as if all scans had been seen.
    pub fn is_warm(&self) -> bool {
        self.known.len() >= MEMORY || !self.config.enabled
    }

    pub(crate) fn save(&self, state: &mut State) {
        state.put(self.known.len() as u64);
        for (plane, extent) in &self.known {
            state.put_reals(&plane.centre);
            state.put_reals(&plane.slope);
            state.put_reals(&[plane.rms, *extent]);
        }
    }

    pub(crate) fn load(&mut self, state: &mut State) -> Result<(), StageError> {
        self.known.clear();
        for _ in 0..state.number()? {
            let (centre, slope, [rms, extent]) = (state.reals()?, state.reals()?, state.reals()?);
            self.known.push_back((Plane { centre, slope, rms }, extent));
        }
        Ok(())
    }

    fn find_patches(&mut self, points: &[[f32; 3]], sensor: [f64; 3]) {
        self.ground.clear();
        self.ground.resize(points.len(), false);
        if !self.config.enabled {
            return;
        }
        self.surfaces.find(&self.config, points, [0.0; 3]);
        patch::join(&self.config, &mut self.surfaces, &mut self.patches, &mut self.stack);
        patch::judge(&self.config, &self.surfaces, &mut self.patches, Some(sensor));
        planes_of(&self.surfaces, &self.patches, &mut self.planes);
    }

    /// Keeps the even patches of this scan for the next ones.
    fn remember(&mut self) {
        for patch in self.patches.iter().filter(|patch| patch.ground && patch.plane.rms <= self.config.step_m)
        {
            self.known.push_back((patch.plane, patch.extent));
            if self.known.len() > MEMORY {
                self.known.pop_front();
            }
        }
    }

    /// Lowest surfaces that continue a known plane are ground: far ones with too few points for a plane, small ones
    /// behind pillars, and the strip of floor in front of a near wall.
    fn extend(&mut self) {
        for cell in &self.surfaces.cells {
            let [lowest, end] = cell.surfaces;
            if lowest == end || self.planes[lowest as usize].is_some() {
                continue;
            }
            let [x, y, z] = self.surfaces.list[lowest as usize].mean;
            self.planes[lowest as usize] = self.known.iter().rev().find_map(|(plane, extent)| {
                // A patch reaches half its length from its centre, and is trusted one length farther.
                let near = (x - plane.centre[0]).hypot(y - plane.centre[1]) <= 1.5 * extent;
                (near && (z - plane.height(x, y)).abs() <= self.config.thickness_m).then_some(*plane)
            });
        }
    }

    /// Marks the points near the ground's plane in their own or a neighbouring cell.
    fn mark(&mut self, points: &[[f32; 3]]) {
        for cell in &self.surfaces.cells {
            let around = cell.neighbours.iter().filter(|cell| **cell != NONE);
            let ranges = around.map(|i| self.surfaces.cells[*i as usize].surfaces);
            let planes = || {
                std::iter::once(cell.surfaces)
                    .chain(ranges.clone())
                    .flat_map(|[from, to]| &self.planes[from as usize..to as usize])
                    .flatten()
            };
            if planes().next().is_none() {
                continue;
            }
            let [from, to] = cell.entries;
            let [first, end] = cell.surfaces;
            let cell_surfaces = &self.surfaces.list[first as usize..end as usize];
            let above = thickness_above(&self.config, cell_surfaces);
            for entry in &self.surfaces.entries[from as usize..to as usize] {
                let [x, y, z] = self.surfaces.relative(points[entry.index as usize]);
                let on =
                    |plane: &Plane| (-self.config.thickness_m..=above).contains(&(z - plane.height(x, y)));
                self.ground[entry.index as usize] = planes().any(on);
            }
        }
    }
}

/// How far above the ground's plane a cell's points are ground. Where something stands in the cell, half as far: of a wall, a
/// riser or a bench more stays, and ground so near to them spreads less than that.
fn thickness_above(config: &GroundConfig, surfaces: &[Surface]) -> f64 {
    let foot = surfaces.iter().any(|surface| surface.foot);
    if foot { 0.5 * config.thickness_m } else { config.thickness_m }
}

/// By surface, its plane where it is part of the ground.
fn planes_of(surfaces: &Surfaces, patches: &[Patch], planes: &mut Vec<Option<Plane>>) {
    planes.clear();
    for surface in &surfaces.list {
        let patch = patches.get(surface.patch as usize).filter(|patch| patch.ground);
        planes.push(patch.and(surface.plane));
    }
}

#[cfg(test)]
mod tests;
