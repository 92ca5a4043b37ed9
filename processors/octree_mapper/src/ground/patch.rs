//! Contiguous horizontal surfaces, and which of them are ground.

use super::moments::{Moments, Plane};
use super::surfaces::{NONE, Surface, Surfaces};
use crate::GroundConfig;

/// How far beside a table its floor is looked for, metres.
const BESIDE_M: f64 = 1.0;

/// A contiguous horizontal surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patch {
    /// Of all its cells, for the extent; every cell counts the same, however many points it holds.
    all: Moments,
    /// Of the cells with a plane of their own, for the plane: the feet of walls would tilt it.
    inner: Moments,
    /// Lowest and highest x and y of its cells' points.
    low: [f64; 2],
    high: [f64; 2],
    /// Height of its lowest cell.
    bottom: f64,
    /// Plane through the whole patch.
    pub(super) plane: Plane,
    /// Length, metres.
    pub(super) extent: f64,
    /// What is above and below its cells (no sensor position).
    column: Column,
    pub(super) ground: bool,
}

/// How many cells of a patch there are, and have another level close above, anything above, or anything below.
#[derive(Debug, Clone, Copy, Default)]
struct Column {
    cells: u32,
    blocked: u32,
    covered: u32,
    below: u32,
}

impl Patch {
    fn new() -> Self {
        Self {
            all: Moments::default(),
            inner: Moments::default(),
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
            bottom: f64::INFINITY,
            plane: Plane::default(),
            extent: 0.0,
            column: Column::default(),
            ground: false,
        }
    }

    fn add(&mut self, surface: &Surface) {
        self.all.merge(&surface.moments, 1.0 / surface.moments.n);
        if surface.plane.is_some() {
            self.inner.merge(&surface.moments, 1.0 / surface.moments.n);
        }
        for axis in 0..2 {
            self.low[axis] = self.low[axis].min(surface.mean[axis]);
            self.high[axis] = self.high[axis].max(surface.mean[axis]);
        }
        self.bottom = self.bottom.min(surface.mean[2]);
    }

    /// Whether the other patch is under or beside this one.
    fn near(&self, other: &Self) -> bool {
        (0..2).all(|axis| {
            self.low[axis] - BESIDE_M <= other.high[axis] && other.low[axis] - BESIDE_M <= self.high[axis]
        })
    }
}

/// Joins horizontal surfaces whose planes continue each other into patches.
pub(super) fn join(
    config: &GroundConfig,
    surfaces: &mut Surfaces,
    patches: &mut Vec<Patch>,
    stack: &mut Vec<u32>,
) {
    patches.clear();
    for seed in 0..surfaces.list.len() {
        if surfaces.list[seed].plane.is_none() || surfaces.list[seed].patch != NONE {
            continue;
        }
        let number = patches.len() as u32;
        let mut patch = Patch::new();
        surfaces.list[seed].patch = number;
        stack.push(seed as u32);
        while let Some(i) = stack.pop() {
            let surface = surfaces.list[i as usize];
            patch.add(&surface);
            let Some(plane) = surface.plane else { continue };
            for slot in surfaces.cells[surface.cell as usize].neighbours {
                if slot == NONE {
                    continue;
                }
                let [from, to] = surfaces.cells[slot as usize].surfaces;
                for j in from..to {
                    let other = &mut surfaces.list[j as usize];
                    // A surface at the edge (a wall's foot) has no plane of its own: it joins and ends the patch.
                    let continues =
                        |p: &Plane, m: &[f64; 3]| (m[2] - p.height(m[0], m[1])).abs() <= config.step_m;
                    if other.patch == NONE
                        && continues(&plane, &other.mean)
                        && other.plane.is_none_or(|plane| continues(&plane, &surface.mean))
                    {
                        other.patch = number;
                        stack.push(j);
                    }
                }
            }
        }
        patches.push(patch);
    }
}

/// Decides which patches are ground: by extent, tilt and height below the sensor, or by the room above where there is
/// no sensor position; table tops are left out.
pub(super) fn judge(
    config: &GroundConfig,
    surfaces: &Surfaces,
    patches: &mut [Patch],
    sensor: Option<[f64; 3]>,
) {
    let slope = config.max_tilt_deg.to_radians().tan();
    for patch in patches.iter_mut() {
        let [narrow, wide] = patch.all.extents();
        patch.extent = wide;
        if let Some(plane) = patch.inner.plane() {
            patch.plane = plane;
            patch.ground = narrow >= config.min_extent_m && plane.tilt() <= slope;
        }
    }
    match sensor {
        Some(sensor) => {
            let [least, most] = config.below_sensor_m;
            for patch in patches.iter_mut() {
                patch.ground &= (least..=most).contains(&(sensor[2] - patch.bottom));
            }
        }
        None => leave_ceilings(config, surfaces, patches),
    }
    leave_table_tops(config, patches);
}

/// Without a sensor position the levels above and below tell: a surface close under another one is the underside of a
/// slab; one with nothing above but something below is a ceiling.
fn leave_ceilings(config: &GroundConfig, surfaces: &Surfaces, patches: &mut [Patch]) {
    for surface in surfaces.list.iter().filter(|surface| surface.patch != NONE) {
        let (mut blocked, mut covered, mut below) = (false, false, false);
        for other in surfaces.of_cell(surface.cell).chain(surfaces.around(surface.cell)) {
            let step = other.mean[2] - surface.mean[2];
            covered |= step >= config.headroom_m;
            below |= step <= -config.headroom_m;
            blocked |= step > config.thickness_m && step < config.headroom_m && is_candidate(other, patches);
        }
        let column = &mut patches[surface.patch as usize].column;
        column.cells += 1;
        column.blocked += u32::from(blocked);
        column.covered += u32::from(covered);
        column.below += u32::from(below);
    }
    for i in 0..patches.len() {
        let patch = &patches[i];
        let Column { cells, blocked, covered, below } = patch.column;
        let over_ground = || {
            patches.iter().any(|floor| {
                floor.ground
                    && floor.extent > patch.extent
                    && patch.plane.centre[2] - floor.plane.centre[2] >= config.headroom_m
                    && floor.near(patch)
            })
        };
        let ceiling = 2 * covered < cells && (2 * below > cells || over_ground());
        patches[i].ground &= 2 * blocked <= cells && !ceiling;
    }
}

fn is_candidate(surface: &Surface, patches: &[Patch]) -> bool {
    patches.get(surface.patch as usize).is_some_and(|patch| patch.ground)
}

/// A small surface at table height over a larger ground beside it is furniture.
fn leave_table_tops(config: &GroundConfig, patches: &mut [Patch]) {
    let [least, most] = config.furniture_height_m;
    for i in 0..patches.len() {
        let top = &patches[i];
        if !top.ground || top.extent > config.furniture_extent_m {
            continue;
        }
        let [x, y, z] = top.plane.centre;
        let furniture = patches.iter().any(|floor| {
            floor.ground
                && floor.extent > top.extent
                && (least..=most).contains(&(z - floor.plane.height(x, y)))
                && floor.near(top)
        });
        patches[i].ground = !furniture;
    }
}
