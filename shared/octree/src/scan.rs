//! One scan into the map.

use crate::key::{Key, KeySpace};
use crate::map::OctreeMap;
use crate::marks::ScanMarks;
use crate::morton;
use crate::trace::{direction_and_length, trace};

/// The points of one scan: `f32` metres in the map frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scan<'a> {
    /// Where the LiDAR was.
    pub origin: [f32; 3],
    /// Points on obstacles: the ray to them is free, the voxel they are in occupied.
    pub hits: &'a [[f32; 3]],
    /// Points on the ground: the ray to them and the voxel they are in are free, unless a hit is in it, and the voxel
    /// gets the ground flag.
    pub ground: &'a [[f32; 3]],
    /// Ends of rays that met nothing: the ray is free, the end's voxel stays as it is.
    pub misses: &'a [[f32; 3]],
}

/// How a scan goes into the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanOptions {
    /// Metres. A longer ray is cut here: it clears, but its end says nothing. `None`: no limit.
    pub max_range: Option<f64>,
    /// Casts one ray to the centre of each voxel with points, not one to each point. As OctoMap's `discretize`: faster,
    /// and slightly different.
    pub discretize: bool,
    /// Only voxels in this box, borders included, change. As OctoMap's `useBBXLimit` with the origin in the box.
    pub bounds: Option<Bounds>,
}

/// An axis-aligned box in the map frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: [f32; 3],
    /// Upper corner.
    pub max: [f32; 3],
}

/// What became of a scan's points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanReport {
    /// Hits that occupied a voxel.
    pub hits: u32,
    /// Ground points that cleared and flagged a voxel.
    pub ground: u32,
    /// Points that only cleared their ray: misses, and points beyond the range or outside the box.
    pub cleared: u32,
    /// Points dropped because they, or the origin, are NaN or infinite.
    pub not_finite: u32,
    /// Points dropped because they, or the origin, are beyond the key space.
    pub outside: u32,
    /// Voxels that got a miss.
    pub free_voxels: u32,
    /// Voxels that got a hit.
    pub occupied_voxels: u32,
    /// Voxels with a new value or a new flag; see [`OctreeMap::changes`].
    pub changed: u32,
    /// Bricks of 8 x 8 x 8 voxels that the ceiling kept out. A scan that alone touches more bricks than the ceiling
    /// counts such a brick each time that a ray enters it.
    pub refused_bricks: u32,
}

impl OctreeMap {
    /// Adds one scan: every voxel gets at most one update, a hit where a point is in it, otherwise a miss where a ray
    /// passes. The result does not depend on the order of the points (only which bricks are refused may, where a single
    /// scan touches more bricks than [`crate::MapConfig::max_bricks`]).
    ///
    /// Same voxels and values as OctoMap's `insertPointCloud`; ground and misses as `octomap_server` adds ground points,
    /// except that the voxel of a ground point is free, too. A point or origin without a key is dropped and counted.
    ///
    /// Allocates only while a scan touches more bricks than any before, or new ones.
    pub fn insert_scan(&mut self, scan: &Scan<'_>, options: &ScanOptions) -> ScanReport {
        let mut report = ScanReport::default();
        self.marks.clear();
        if self.space().key(scan.origin).is_some() {
            let space = *self.space();
            let bounds = options.bounds.map(|bounds| KeyBounds::new(&space, bounds));
            let mut caster = Caster {
                space,
                origin: scan.origin,
                options: *options,
                bounds,
                marks: &mut self.marks,
                report: &mut report,
            };
            caster.cast_all(scan);
        } else {
            let points = (scan.hits.len() + scan.ground.len() + scan.misses.len()) as u32;
            let finite = scan.origin.iter().all(|c| c.is_finite());
            *(if finite { &mut report.outside } else { &mut report.not_finite }) = points;
        }
        report.refused_bricks = self.marks.refused;
        self.apply_marks(&mut report);
        report
    }
}

/// What the end of a ray says about its voxel.
#[derive(Clone, Copy, PartialEq)]
enum End {
    Hit,
    Ground,
    Nothing,
}

/// Casts the rays of one scan into its marks.
struct Caster<'a> {
    space: KeySpace,
    origin: [f32; 3],
    options: ScanOptions,
    bounds: Option<KeyBounds>,
    marks: &'a mut ScanMarks,
    report: &'a mut ScanReport,
}

impl Caster<'_> {
    fn cast_all(&mut self, scan: &Scan<'_>) {
        for (points, end) in [(scan.hits, End::Hit), (scan.ground, End::Ground), (scan.misses, End::Nothing)]
        {
            for &point in points {
                self.cast(point, end);
            }
        }
    }

    fn cast(&mut self, mut point: [f32; 3], end: End) {
        if !point.iter().all(|c| c.is_finite()) {
            self.report.not_finite += 1;
            return;
        }
        if self.options.discretize && end != End::Nothing {
            let Some(key) = self.space.key(point) else {
                self.report.outside += 1;
                return;
            };
            point = self.space.centre(key).map(|c| c as f32);
            let code = morton::encode(key);
            // The same ray again would mark the same voxels.
            let seen = if end == End::Hit { self.marks.is_hit(code) } else { self.marks.is_ground(code) };
            if seen {
                *(if end == End::Hit { &mut self.report.hits } else { &mut self.report.ground }) += 1;
                return;
            }
        }
        let (direction, length) = direction_and_length(self.origin, point);
        if let Some(range) = self.options.max_range.filter(|&range| length > range) {
            let cut = std::array::from_fn(|axis| self.origin[axis] + direction[axis] * range as f32);
            self.cast_to(cut, End::Nothing);
        } else if self.bounds.is_none_or(|bounds| bounds.hold_point(point)) {
            self.cast_to(point, end);
        } else {
            self.cast_to(point, End::Nothing);
        }
    }

    fn cast_to(&mut self, point: [f32; 3], end: End) {
        let marks = &mut *self.marks;
        let traced = match &self.bounds {
            None => trace(&self.space, self.origin, point, |code| marks.mark_free(code)),
            Some(bounds) => trace(&self.space, self.origin, point, |code| {
                if bounds.hold_key(morton::decode(code)) {
                    marks.mark_free(code);
                }
            }),
        };
        match traced {
            Some(last) => self.finish(last, end),
            None => self.report.outside += 1,
        }
    }

    fn finish(&mut self, last: u64, end: End) {
        match end {
            End::Hit => {
                self.marks.mark_hit(last);
                self.report.hits += 1;
            }
            End::Ground => {
                self.marks.mark_ground(last);
                self.report.ground += 1;
            }
            End::Nothing => self.report.cleared += 1,
        }
    }
}

/// [`Bounds`] with their keys, both inclusive.
#[derive(Clone, Copy)]
struct KeyBounds {
    points: Bounds,
    min: Key,
    max: Key,
}

impl KeyBounds {
    fn new(space: &KeySpace, points: Bounds) -> Self {
        Self { points, min: space.nearest_key(points.min), max: space.nearest_key(points.max) }
    }

    fn hold_point(&self, point: [f32; 3]) -> bool {
        (0..3).all(|axis| point[axis] >= self.points.min[axis] && point[axis] <= self.points.max[axis])
    }

    fn hold_key(&self, key: Key) -> bool {
        (0..3).all(|axis| key[axis] >= self.min[axis] && key[axis] <= self.max[axis])
    }
}
