//! One message of points as a scan whose times may still be open.

use evac_formats::ros::{CustomMsg, PointCloud2, TimeUnit};
use evac_frames::Point;

/// Seconds of this many nanoseconds and more are dates, not times since the cloud's stamp.
const DATE_NS: f64 = 1e16;
/// Stamps outside of this are damaged; it keeps sums far from the limits of `i64` (year 2116).
const LAST_STAMP: i64 = 1 << 62;

/// A cloud as it is read.
#[derive(Debug, Default)]
pub(super) struct Cloud {
    /// Time that the points' offsets count from, nanoseconds.
    pub(super) start_ns: i64,
    /// Time of the last point after `start_ns`; `None` for a cloud without times, to be spread over its frame.
    pub(super) last_ns: Option<i64>,
    pub(super) points: Vec<Point>,
    pub(super) no_return: u32,
    /// Points that were not finite; they are kept as points without return, so that the others keep their index.
    pub(super) rejected: u32,
}

impl Cloud {
    /// Replaces the cloud by a Livox message.
    pub(super) fn read_custom(&mut self, message: &CustomMsg<'_>) -> Result<(), String> {
        self.clear(message.timebase_ns)?;
        let mut last = 0;
        for point in (0..message.len()).filter_map(|index| message.point(index)) {
            let offset = i64::from(point.offset_ns);
            last = last.max(offset);
            self.push(point.position, offset, point.reflectivity);
        }
        self.finish(last)
    }

    /// Replaces the cloud by a `PointCloud2`; `unit` is that of its times, found in the first cloud that shows it.
    pub(super) fn read_cloud(
        &mut self,
        cloud: &PointCloud2<'_>,
        unit: &mut Option<TimeUnit>,
    ) -> Result<(), String> {
        self.clear(cloud.header.stamp_ns)?;
        let points = || (0..cloud.len()).filter_map(|index| cloud.point(index));
        let times = points().filter_map(|point| point.time).filter(|time| time.is_finite());
        let (low, high) =
            times.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| (low.min(t), high.max(t)));
        if low > high {
            for point in points() {
                self.push(point.position, 0, point.intensity);
            }
            return Ok(());
        }
        *unit = unit.or_else(|| TimeUnit::of_frame(high - low));
        let Some(ns) = unit.map(TimeUnit::nanoseconds) else {
            return Err(format!(
                "the points' times from {low} to {high} are a frame in no unit from s to ns"
            ));
        };
        if low * ns > DATE_NS {
            self.clear((low * ns) as i64)?;
        } else if low < 0.0 {
            // Stamped at its end: times count backwards.
            self.clear(self.start_ns.saturating_add((low * ns) as i64))?;
        }
        let base = if low < 0.0 || low * ns > DATE_NS { low } else { 0.0 };
        for point in points() {
            let time = point.time.filter(|time| time.is_finite()).unwrap_or(base);
            self.push(point.position, ((time - base) * ns).round() as i64, point.intensity);
        }
        self.finish(((high - base) * ns).round() as i64)
    }

    /// Spreads the points of a cloud without times evenly over `spacing_ns`.
    pub(super) fn spread(&mut self, spacing_ns: i64) {
        let count = self.points.len().max(1) as i64;
        for (index, point) in self.points.iter_mut().enumerate() {
            *point = Point::new(
                point.x,
                point.y,
                point.z,
                index as i64 * spacing_ns / count,
                point.reflectivity(),
            );
        }
    }

    fn clear(&mut self, start_ns: i64) -> Result<(), String> {
        if !(0..LAST_STAMP).contains(&start_ns) {
            return Err(format!("its time is {start_ns} ns"));
        }
        self.points.clear();
        (self.start_ns, self.last_ns, self.no_return, self.rejected) = (start_ns, None, 0, 0);
        Ok(())
    }

    fn push(&mut self, [x, y, z]: [f32; 3], offset_ns: i64, reflectivity: u8) {
        let mut point = Point::new(x, y, z, offset_ns, reflectivity);
        if !point.is_finite() {
            self.rejected += 1;
            point = point.moved_to(0.0, 0.0, 0.0);
        } else if !point.is_return() {
            self.no_return += 1;
        }
        self.points.push(point);
    }

    fn finish(&mut self, last_ns: i64) -> Result<(), String> {
        if last_ns > Point::MAX_OFFSET_NS {
            let (is, most) = (last_ns / 1_000_000, Point::MAX_OFFSET_NS / 1_000_000);
            return Err(format!(
                "the frame lasts {is} ms, and a scan may last {most} ms: record with 10 frames a second"
            ));
        }
        self.last_ns = Some(last_ns);
        Ok(())
    }
}
