//! Good points of a scan with a small field of view, and edges and surfaces among them (paper, sections II.A and II.B).

use evac_frames::Point;
use evac_geometry::nalgebra::Vector3;

use super::config::LoamConfig;

/// Neighbours on either side along the scan line.
const REACH: usize = 5;
/// Up to these ranges neighbours are every fourth and every second shot, so that a window is about as long on the surface
/// everywhere (8 to 10 cm to either side up to 10 m): shorter ones show the range noise only.
const STRIDES: [(f64, usize); 2] = [(2.5, 4), (5.0, 2)];
/// Longest time between two shots that are neighbours, nanoseconds: shots without return lie between.
const MAX_STEP_NS: i64 = 60_000;
/// Most points that a frame is taken to have.
pub(crate) const MAX_POINTS: usize = 1 << 16;

/// A point that is matched, LiDAR frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Feature {
    pub(crate) point: Vector3<f64>,
    /// Time since the frame's start, nanoseconds.
    pub(crate) offset_ns: i64,
}

/// Features of one scan, in the order of time. Buffers are allocated once.
#[derive(Debug)]
pub(crate) struct Features {
    pub(crate) surfaces: Vec<Feature>,
    pub(crate) edges: Vec<Feature>,
    shots: Vec<Shot>,
    limits: Limits,
}

/// A valid point and what is known of it.
#[derive(Debug, Clone, Copy)]
struct Shot {
    point: Vector3<f64>,
    range: f64,
    offset_ns: i64,
    bad: bool,
}

/// The configuration in the units that are compared with.
#[derive(Debug, Clone, Copy)]
struct Limits {
    ranges: (f64, f64),
    deflection_cosine: f64,
    intensities: (f64, f64),
    incidence_cosine: f64,
    occlusion_share: f64,
    smooth: f64,
    sharp: f64,
}

impl Features {
    pub(crate) fn new(config: &LoamConfig) -> Self {
        Self {
            surfaces: Vec::with_capacity(MAX_POINTS),
            edges: Vec::with_capacity(MAX_POINTS),
            shots: Vec::with_capacity(MAX_POINTS),
            limits: Limits {
                ranges: (config.min_range_m, config.max_range_m),
                deflection_cosine: config.max_deflection_deg.to_radians().cos(),
                intensities: (config.min_intensity, config.max_intensity),
                incidence_cosine: config.min_incidence_deg.to_radians().cos(),
                occlusion_share: config.occlusion_share,
                smooth: config.surface_smoothness_m,
                sharp: config.edge_smoothness_m,
            },
        }
    }

    /// Finds the features of a scan; returns how many points were not finite or out of range.
    pub(crate) fn extract(&mut self, points: &[Point]) -> u64 {
        self.surfaces.clear();
        self.edges.clear();
        self.shots.clear();
        let mut rejected = 0;
        for point in points.iter().take(MAX_POINTS) {
            match self.limits.shot(point) {
                Some(shot) => self.shots.push(shot),
                None => rejected += 1,
            }
        }
        self.mark_hidden();
        for index in 0..self.shots.len() {
            match self.kind(index) {
                Some((feature, true)) => self.edges.push(feature),
                Some((feature, false)) => self.surfaces.push(feature),
                None => {}
            }
        }
        rejected
    }

    /// Marks what lies just behind an edge (paper, Fig. 3): whether it is there depends on the viewpoint.
    fn mark_hidden(&mut self) {
        for next in 1..self.shots.len() {
            let (Some(a), Some(b)) = (self.shots.get(next - 1), self.shots.get(next)) else { return };
            let jump = (a.point - b.point).norm();
            let hidden = if a.range > b.range { a.range } else { b.range };
            if b.offset_ns - a.offset_ns > MAX_STEP_NS || jump < self.limits.occlusion_share * hidden {
                continue;
            }
            let behind = if a.range > b.range {
                next.saturating_sub(REACH)..next
            } else {
                next..(next + REACH).min(self.shots.len())
            };
            for shot in self.shots.get_mut(behind).unwrap_or_default() {
                // Only what is as far as the hidden one: a thin object lies between two jumps.
                shot.bad |= shot.range > (1.0 - self.limits.occlusion_share / 2.0) * hidden;
            }
        }
    }

    /// The feature at `index` and whether it is an edge; `None` if it is neither or not good.
    fn kind(&self, index: usize) -> Option<(Feature, bool)> {
        let shot = self.shots.get(index).filter(|shot| !shot.bad)?;
        let stride = STRIDES.iter().find(|(range, _)| shot.range < *range).map_or(1, |(_, stride)| *stride);
        let arms = [self.arm(index, -(stride as isize))?, self.arm(index, stride as isize)?];
        let along = arms[1] - arms[0];
        // Distance from the line through both arms' means: a surface that is seen at a slant, where the spacing of the
        // shots grows along the line, is smooth by this measure, and by the distance from the neighbours' mean it is not.
        let sharpness = arms[0].cross(&arms[1]).norm() / along.norm();
        let feature = Feature { point: shot.point, offset_ns: shot.offset_ns };
        let sides = [self.goes_on(index, -1)?, self.goes_on(index, 1)?];
        match sides {
            [true, true] if sharpness < self.limits.smooth => {
                self.is_steep(shot, &along).then_some((feature, false))
            }
            [true, true] => (sharpness > self.limits.sharp).then_some((feature, true)),
            // The near border of a surface: it goes on at one side and ends before something farther at the other.
            [true, false] => {
                (self.is_steep(shot, &arms[0]) && self.ends(index, 1)).then_some((feature, true))
            }
            [false, true] => {
                (self.is_steep(shot, &arms[1]) && self.ends(index, -1)).then_some((feature, true))
            }
            [false, false] => None,
        }
    }

    /// Mean of the neighbours at one side, relative to the point.
    fn arm(&self, index: usize, stride: isize) -> Option<Vector3<f64>> {
        let shot = self.shots.get(index)?;
        let mut sum = Vector3::zeros();
        for step in 1..=REACH as isize {
            let other = self.shots.get(index.checked_add_signed(step * stride)?)?;
            sum += other.point - shot.point;
            if (other.offset_ns - shot.offset_ns).abs() > MAX_STEP_NS * step as i64 {
                return None;
            }
        }
        Some(sum / REACH as f64)
    }

    /// Whether the scan line goes on without a jump at that side.
    fn goes_on(&self, index: usize, side: isize) -> Option<bool> {
        let mut last = self.shots.get(index)?;
        for step in 1..=REACH as isize {
            let next = self.shots.get(index.checked_add_signed(step * side)?)?;
            if (next.point - last.point).norm() > self.limits.occlusion_share * last.range {
                return Some(false);
            }
            last = next;
        }
        Some(true)
    }

    /// Whether all at that side is clearly farther away, from the next shot on.
    fn ends(&self, index: usize, side: isize) -> bool {
        let Some(shot) = self.shots.get(index) else { return false };
        let beyond = (1.0 + self.limits.occlusion_share) * shot.range;
        (1..=REACH as isize).all(|step| {
            let other = index.checked_add_signed(step * side).and_then(|index| self.shots.get(index));
            other.is_some_and(|other| other.range > beyond)
        })
    }

    /// Whether the beam meets the line at no grazing angle; NaN, for neighbours in one place, is none.
    fn is_steep(&self, shot: &Shot, along: &Vector3<f64>) -> bool {
        along.dot(&shot.point).abs() / (along.norm() * shot.range) < self.limits.incidence_cosine
    }
}

impl Limits {
    fn shot(&self, point: &Point) -> Option<Shot> {
        let position = Vector3::new(f64::from(point.x), f64::from(point.y), f64::from(point.z));
        let range = position.norm();
        // NaN is outside every range.
        if !(self.ranges.0..=self.ranges.1).contains(&range) || range == 0.0 {
            return None;
        }
        let intensity = f64::from(point.reflectivity()) / (range * range);
        let bad_echo =
            point.reflectivity() > 0 && !(self.intensities.0..=self.intensities.1).contains(&intensity);
        let bad = position.x < self.deflection_cosine * range || bad_echo;
        Some(Shot { point: position, range, offset_ns: point.offset_ns(), bad })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A horizontal scan line of 2001 shots from -16 to 16 degrees; `range` by the tangent of the angle.
    fn line(range: impl Fn(f64) -> f64) -> Vec<Point> {
        (0..2001)
            .map(|i| {
                let angle = (f64::from(i) / 1000.0 - 1.0) * 16.0_f64.to_radians();
                let depth = range(angle.tan());
                Point::new(depth as f32, (depth * angle.tan()) as f32, 0.0, i64::from(i) * 10_000, 50)
            })
            .collect()
    }

    fn extract(points: &[Point]) -> Features {
        let mut features = Features::new(&LoamConfig::default());
        features.extract(points);
        features
    }

    #[test]
    fn a_wall_is_all_surface() {
        let features = extract(&line(|_| 3.0));
        assert!(features.surfaces.len() > 1900 && features.edges.is_empty());
    }

    #[test]
    fn the_near_border_of_a_post_is_an_edge_and_the_wall_just_behind_it_is_nothing() {
        let features = extract(&line(|tan| if tan.abs() < 0.1 { 4.0 } else { 6.0 }));
        assert!(!features.edges.is_empty());
        for edge in &features.edges {
            assert!((edge.point.x - 4.0).abs() < 1e-6 && edge.point.y.abs() > 0.35, "{edge:?}");
        }
        let shadow = |point: &Vector3<f64>| point.x > 5.0 && (point.y / point.x).abs() < 0.1005;
        assert!(features.surfaces.iter().chain(&features.edges).all(|feature| !shadow(&feature.point)));
    }

    #[test]
    fn a_stray_return_is_no_feature() {
        let mut points = line(|_| 5.0);
        points[900] = points[900].moved_to(2.0, -0.06, 0.0);
        let features = extract(&points);
        assert!(features.surfaces.iter().chain(&features.edges).all(|feature| feature.point.x > 4.9));
    }

    #[test]
    fn a_wall_that_the_beam_grazes_is_left_out() {
        // Walls at both sides, 0.4 m away, up to a door 8 m ahead.
        let features = extract(&line(|tan| 0.4 / tan.abs().max(0.05)));
        let on_wall = |feature: &&Feature| feature.point.x < 7.9;
        let angles: Vec<f64> = (features.surfaces.iter().filter(on_wall))
            .map(|feature| (feature.point.y / feature.point.x).abs().atan().to_degrees())
            .collect();
        assert!(angles.len() > 500 && angles.iter().all(|angle| *angle > 4.8), "{angles:?}");
    }

    #[test]
    fn the_rim_of_the_view_and_faint_echoes_are_left_out() {
        let rim: Vec<Point> = line(|_| 3.0).iter().map(|p| p.moved_to(p.x, p.y, 0.32 * p.x)).collect();
        assert!(extract(&rim).surfaces.iter().all(|f| f.point.yz().norm() < 0.306 * f.point.x));
        let faint: Vec<Point> = (line(|_| 3.0).iter())
            .map(|p| Point::new(p.x * 20.0, p.y * 20.0, p.z, p.offset_ns(), 20))
            .collect();
        assert!(extract(&faint).surfaces.is_empty());
    }

    #[test]
    fn points_that_are_none_are_counted() {
        let mut points = line(|_| 3.0);
        points[5] = points[5].moved_to(f32::NAN, 0.0, 0.0);
        points[9] = points[9].moved_to(0.0, 0.0, 0.0);
        assert_eq!(Features::new(&LoamConfig::default()).extract(&points), 2);
    }
}
