//! One scan into the map.

use crate::coarse::CoarseCaster;
use crate::key::{Key, KeySpace};
use crate::map::OctreeMap;
use crate::rays::{Helper, Origin, Ray};
use crate::trace::direction_and_length;
use crate::window::Window;

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
    /// Clears blocks of 4 x 4 x 4 voxels instead of voxels: each block that a ray passes, except those in which a hit of this
    /// scan lies. Hits are exact. Several times faster and **not** OctoMap's result: thin things beside a ray are cleared
    /// with it, and the last stretch of a ray before its hit is not.
    pub coarse_free_space: bool,
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
    /// Bricks of 8 x 8 x 8 voxels that the ceiling kept out. A scan whose marks alone would need
    /// more bytes than the map may take counts such a brick each time that a ray enters it.
    pub refused_bricks: u32,
}

impl OctreeMap {
    /// Adds one scan: every voxel gets at most one update, a hit where a point is in it, otherwise a miss where a ray
    /// passes. The result does not depend on the order of the points (only which bricks are refused may, where the
    /// marks of a single scan would need more bytes than [`crate::MapConfig::max_bytes`]).
    ///
    /// Same voxels and values as OctoMap's `insertPointCloud`; ground and misses as `octomap_server` adds ground points,
    /// except that the voxel of a ground point is free, too. A point or origin without a key is dropped and counted.
    ///
    /// Allocates only while a scan touches more bricks than any before, for new bricks, for bricks that need more bits and
    /// for values that never occurred before (each doubling of the palette); and to start further threads.
    pub fn insert_scan(&mut self, scan: &Scan<'_>, options: &ScanOptions) -> ScanReport {
        let mut report = ScanReport::default();
        self.marks.clear();
        self.helpers.iter_mut().for_each(Helper::clear);
        if let Some(key) = self.space().key(scan.origin) {
            self.cast_scan(scan, key, options, &mut report);
        } else {
            let points = (scan.hits.len() + scan.ground.len() + scan.misses.len()) as u32;
            let finite = scan.origin.iter().all(|c| c.is_finite());
            *(if finite { &mut report.outside } else { &mut report.not_finite }) = points;
        }
        self.apply_marks(options.bounds.is_some(), &mut report);
        report
    }

    /// Marks what the rays of a scan pass and where they end.
    fn cast_scan(&mut self, scan: &Scan<'_>, key: Key, options: &ScanOptions, report: &mut ScanReport) {
        let bounds = options.bounds.map(|bounds| KeyBounds::new(&self.space, bounds));
        self.rays.clear();
        let mut sorter =
            Sorter { space: &self.space, origin: scan.origin, options, bounds, rays: &mut self.rays, report };
        let hits = sorter.add(scan.hits, End::Hit);
        sorter.add(scan.ground, End::Ground);
        sorter.add(scan.misses, End::Nothing);
        // A block of coarse free space may reach out of the box of the rays.
        let margin = if options.coarse_free_space { 8 } else { 2 };
        self.marks.start(Window::around(key, &self.rays, margin));
        self.mark_ends(hits, options.discretize);
        let from = Origin::new(&self.space, scan.origin, key, self.marks.window());
        let coarse = options.coarse_free_space
            && self.coarse.get_or_insert_with(|| CoarseCaster::new(self.bricks.max_bytes())).cast(
                &self.space,
                scan.origin,
                &self.rays,
                &mut self.caster,
                &mut self.marks,
            );
        if coarse {
            // Nothing is left for other threads.
        } else if self.helpers.is_empty() {
            self.caster.cast(&from, &self.rays, &mut self.marks);
        } else {
            let (own, mut rest) = split_by_steps(&self.rays, key, self.threads);
            std::thread::scope(|scope| {
                for (n, helper) in self.helpers.iter_mut().enumerate() {
                    let (rays, after) = split_by_steps(rest, key, self.threads - 1 - n);
                    rest = after;
                    let from = &from;
                    scope.spawn(move || helper.cast(from, rays));
                }
                self.caster.cast(&from, own, &mut self.marks);
            });
        }
        let bounds = bounds.map(|bounds| (bounds.min, bounds.max));
        if let Some((min, max)) = bounds {
            self.marks.limit(min, max);
        }
        for helper in &mut self.helpers {
            helper.join(&mut self.marks, bounds);
        }
        report.refused_bricks = self.marks.refused;
    }

    /// Marks the ends of the rays, of which the first `hits` end as hits and the others, if their ends say anything, on the ground. Where only `first` rays to a voxel
    /// count, takes the others out: they would mark the same voxels again.
    fn mark_ends(&mut self, hits: usize, first: bool) {
        let mut n = 0;
        let mut marks = |ray: &Ray| {
            let code = self.marks.window().code(ray.key);
            n += 1;
            if !ray.ends {
                return true;
            }
            let is_first = if n <= hits { self.marks.mark_hit(code) } else { self.marks.mark_ground(code) };
            is_first || !first
        };
        if first {
            self.rays.retain(&mut marks);
        } else {
            self.rays.iter().for_each(|ray| {
                marks(ray);
            });
        }
    }
}

/// Takes so many first rays that they have one of `shares` equal shares of all steps.
fn split_by_steps(rays: &[Ray], origin: Key, shares: usize) -> (&[Ray], &[Ray]) {
    let total: u64 = rays.iter().map(|ray| u64::from(ray.steps(origin))).sum();
    let mut left = total / shares.max(1) as u64;
    let mut within = |ray: &Ray| {
        let steps = u64::from(ray.steps(origin));
        let fits = steps <= left;
        left = left.saturating_sub(steps);
        fits
    };
    let taken = if shares <= 1 { rays.len() } else { rays.iter().take_while(|ray| within(ray)).count() };
    rays.split_at(taken)
}

/// What the end of a ray says about its voxel.
#[derive(Clone, Copy, PartialEq)]
enum End {
    Hit,
    Ground,
    Nothing,
}

/// Turns points into rays.
struct Sorter<'a> {
    space: &'a KeySpace,
    origin: [f32; 3],
    options: &'a ScanOptions,
    bounds: Option<KeyBounds>,
    rays: &'a mut Vec<Ray>,
    report: &'a mut ScanReport,
}

impl Sorter<'_> {
    /// Adds the rays to points; gives their number.
    fn add(&mut self, points: &[[f32; 3]], end: End) -> usize {
        let before = self.rays.len();
        for &point in points {
            self.add_one(point, end);
        }
        self.rays.len() - before
    }

    #[inline]
    fn add_one(&mut self, mut point: [f32; 3], end: End) {
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
        }
        let (direction, length) = direction_and_length(self.origin, point);
        let mut ends = end != End::Nothing;
        if let Some(range) = self.options.max_range.filter(|&range| length > range) {
            point = std::array::from_fn(|axis| self.origin[axis] + direction[axis] * range as f32);
            ends = false;
        } else if self.bounds.is_some_and(|bounds| !bounds.hold_point(point)) {
            ends = false;
        }
        let Some(key) = self.space.key(point) else {
            self.report.outside += 1;
            return;
        };
        match end {
            End::Hit if ends => self.report.hits += 1,
            End::Ground if ends => self.report.ground += 1,
            _ => self.report.cleared += 1,
        }
        self.rays.push(Ray { end: point, key, ends });
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
}
