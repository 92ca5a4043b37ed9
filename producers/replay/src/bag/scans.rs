//! Messages of points as scans.

use evac_formats::FormatError;
use evac_formats::bag::{Bag, BagMessage, Messages};
use evac_formats::ros::{CustomMsg, PointCloud2, TimeUnit};
use evac_frames::{FrameHeader, Point, ScanHeader, frame_flags, scan_flags};
use evac_stage::Counters;

use super::bad_message;
use super::cloud::Cloud;
use super::topics::{Kind, Topic};
use crate::Config;
use crate::streams::{SECOND, ScanStream, seconds};

/// Clouds whose spacing tells how long clouds without times last.
const SPACED_CLOUDS: usize = 10;

/// One message is one scan. It begins at its time base (`CustomMsg`) or stamp (`PointCloud2`). A cloud without times is spread over the time to the next one.
pub(super) struct BagScans {
    clouds: Clouds,
    /// The next scan; the one after it is read before it goes out, to know whether it is the last.
    ahead: Option<Cloud>,
    /// Its buffer when there is none ahead.
    spare: Cloud,
    first_ns: i64,
    /// Length of the scan before, for the last one.
    length_ns: i64,
    last_end_ns: i64,
    total: u64,
    /// Points that were not finite.
    rejected: u64,
}

struct Clouds {
    topic: Topic,
    messages: Messages,
    unit: Option<TimeUnit>,
    last_start: Option<i64>,
    late: u64,
    /// The end was reached and what was left out is in the log.
    told: bool,
}

impl BagScans {
    pub(super) fn open(bag: &Bag, topic: Topic, config: &Config) -> Result<Self, FormatError> {
        let mut clouds = Clouds::open(bag, &topic);
        let mut first = Cloud::default();
        let ahead = clouds.read(&mut first)?.then_some(first);
        let first_ns = ahead.as_ref().map_or(0, |cloud| cloud.start_ns);
        let mut length_ns = config.scan_period_ns();
        if ahead.as_ref().is_some_and(|cloud| cloud.last_ns.is_none()) {
            let (file, name) = (bag.path().display(), &topic.name);
            tracing::warn!("{file}: points on {name} carry no time; they are spread evenly over each scan");
            length_ns = Clouds::open(bag, &topic).usual_spacing(length_ns)?;
        }
        Ok(Self {
            clouds,
            ahead,
            spare: Cloud::default(),
            first_ns,
            length_ns,
            last_end_ns: 0,
            total: topic.messages,
            rejected: 0,
        })
    }

    pub(super) fn first_ns(&self) -> i64 {
        self.first_ns
    }
}

impl ScanStream for BagScans {
    fn next_scan(&mut self, points: &mut Vec<Point>) -> Result<Option<ScanHeader>, FormatError> {
        let Some(mut cloud) = self.ahead.take() else { return Ok(None) };
        let mut next = std::mem::take(&mut self.spare);
        let more = self.clouds.read(&mut next)?;
        let next_start = more.then_some(next.start_ns);
        let mut header = ScanHeader {
            points: cloud.points.len() as u32,
            no_return: cloud.no_return,
            rejected: cloud.rejected,
            ..ScanHeader::default()
        };
        self.rejected += u64::from(cloud.rejected);
        let length = match cloud.last_ns {
            Some(last) => {
                let to_next = next_start.map_or(self.length_ns, |next| next - cloud.start_ns);
                measured_length(last, cloud.points.len(), to_next)
            }
            None => {
                header.scan_flags |= scan_flags::TIMES_ASSUMED;
                let length = assumed_length(next_start.map(|next| next - cloud.start_ns), self.length_ns);
                cloud.spread(length);
                length
            }
        };
        self.length_ns = length;
        let flags = if more { 0 } else { frame_flags::END_OF_STREAM };
        let start_ns = cloud.start_ns;
        // Clouds of a driver that stamps by arrival may overlap; ends rise all the same.
        let end_ns = (start_ns + length).max(self.last_end_ns);
        self.last_end_ns = end_ns;
        header.frame = FrameHeader { start_ns, end_ns, flags, ..FrameHeader::default() };
        std::mem::swap(points, &mut cloud.points);
        (self.ahead, self.spare) = if more { (Some(next), cloud) } else { (None, cloud) };
        Ok(Some(header))
    }

    fn total(&self) -> u64 {
        self.total
    }

    fn counters(&self) -> Counters {
        Counters { late: self.clouds.late, rejected: self.rejected, ..Counters::default() }
    }
}

impl Clouds {
    fn open(bag: &Bag, topic: &Topic) -> Self {
        let messages = Messages::new(bag, &topic.connections);
        Self { topic: topic.clone(), messages, unit: None, last_start: None, late: 0, told: false }
    }

    /// The shortest time between two of the first clouds; `default` where there is only one.
    fn usual_spacing(mut self, default: i64) -> Result<i64, FormatError> {
        let (mut cloud, mut before, mut shortest) = (Cloud::default(), None, None::<i64>);
        for _ in 0..SPACED_CLOUDS {
            if !self.read(&mut cloud)? {
                break;
            }
            if let Some(spacing) = before.replace(cloud.start_ns).map(|before| cloud.start_ns - before) {
                shortest = Some(shortest.map_or(spacing, |shortest| shortest.min(spacing)));
            }
        }
        match shortest {
            Some(spacing) if spacing > Point::MAX_OFFSET_NS => {
                let (file, topic) = (self.messages.path(), &self.topic.name);
                let (is, most) = (spacing / 1_000_000, Point::MAX_OFFSET_NS / 1_000_000);
                let cause = format!("clouds on {topic} come each {is} ms, and a scan may last {most} ms");
                Err(FormatError::malformed(file, 0, cause, "record with 10 clouds a second"))
            }
            spacing => Ok(spacing.unwrap_or(default)),
        }
    }

    /// Reads the next message whose time rises; `false` after the last.
    fn read(&mut self, cloud: &mut Cloud) -> Result<bool, FormatError> {
        while let Some(message) = self.messages.next_message()? {
            let offset = message.offset;
            let parsed = parse(&self.topic, &message, cloud, &mut self.unit);
            let bad = |cause: String| bad_message(self.messages.path(), offset, &self.topic.name, &cause);
            parsed.map_err(bad)?;
            let back = self.last_start.map_or(-1, |last| last - cloud.start_ns);
            if back < 0 {
                self.last_start = Some(cloud.start_ns);
                return Ok(true);
            }
            if back > SECOND {
                let (from, to) = (seconds(cloud.start_ns + back), seconds(cloud.start_ns));
                let cause = format!("time goes back from {from:.3} s to {to:.3} s; the LiDAR was restarted");
                return Err(bad(cause));
            }
            self.late += 1;
        }
        if self.late > 0 && !std::mem::replace(&mut self.told, true) {
            let (file, topic) = (self.messages.path().display(), &self.topic.name);
            tracing::warn!("{file}: left out {} messages on {topic} whose times do not rise", self.late);
        }
        Ok(false)
    }
}

fn parse(
    topic: &Topic,
    message: &BagMessage<'_>,
    cloud: &mut Cloud,
    unit: &mut Option<TimeUnit>,
) -> Result<(), String> {
    match topic.kind {
        Kind::CustomMsg => {
            let message =
                CustomMsg::parse(message.data, topic.encoding).map_err(|cause| cause.to_string())?;
            cloud.read_custom(&message)
        }
        // An IMU topic is never chosen for points; its messages would be refused here.
        Kind::PointCloud2 | Kind::Imu => {
            let message =
                PointCloud2::parse(message.data, topic.encoding).map_err(|cause| cause.to_string())?;
            cloud.read_cloud(&message, unit)
        }
    }
}

/// From the first point to one point after the last; or to the next scan where that is about the same, since a recorder
/// that leaves out shots without return moves the last point, or sooner.
fn measured_length(last_ns: i64, points: usize, to_next: i64) -> i64 {
    let length = last_ns + last_ns / (points as i64 - 1).max(1);
    if to_next >= last_ns && to_next <= length + length / 20 { to_next } else { length }
}

/// The time to the next cloud; the length of the clouds before where one is missing between, or none follows.
fn assumed_length(to_next: Option<i64>, before: i64) -> i64 {
    to_next.filter(|spacing| *spacing <= before + before / 2).unwrap_or(before)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_ends_one_point_after_its_last_or_where_the_next_begins() {
        assert_eq!(measured_length(99_990_000, 10_000, 200_000_000), 100_000_000);
        assert_eq!(measured_length(99_900_000, 9_000, 100_000_000), 100_000_000);
        assert_eq!(measured_length(99_990_000, 10_000, 99_000_000), 100_000_000);
        assert_eq!(measured_length(90_000_000, 2, 100_000_000), 100_000_000);
        assert_eq!(measured_length(0, 1, 100_000_000), 0);
        assert_eq!(measured_length(0, 0, 100_000_000), 0);
    }

    #[test]
    fn a_missing_cloud_does_not_stretch_the_one_before() {
        assert_eq!(assumed_length(Some(100), 100), 100);
        assert_eq!(assumed_length(Some(200), 100), 100);
        assert_eq!(assumed_length(Some(50), 100), 50);
        assert_eq!(assumed_length(None, 50), 50);
    }
}
