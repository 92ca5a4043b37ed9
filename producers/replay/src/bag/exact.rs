//! Recordings of evac's own recorder: frames as they lay in shared memory, played back bit by bit.

use bytemuck::Pod;
use evac_formats::FormatError;
use evac_formats::bag::{Bag, BagMessage, Connection, Messages};
use evac_formats::ros::{Encoding, octets};
use evac_frames::{ImuSample, Layout, Point, PoseFrame, ScanHeader, frame_flags, layout_hash};
use evac_stage::{Counters, StageError};

use super::bad_message;
use crate::source::file;
use crate::streams::{ImuStream, Recording, ScanStream};

const SCANS: &str = "/evac/lidar/scan";
const IMU: &str = "/evac/imu/sample";
const TRUTH: &str = "/evac/truth/pose";

/// Times outside of this are damaged; it keeps sums far from the limits of `i64`.
const LAST_TIME: i64 = 1 << 62;

/// Opens a recording's raw frames; `None` where it has none.
pub(super) fn open(bag: &Bag) -> Result<Option<Recording>, StageError> {
    let (Some(scans), Some(imu)) = (connection(bag, SCANS), connection(bag, IMU)) else { return Ok(None) };
    check_layout::<ScanHeader>(bag, scans, "header_layout")?;
    check_layout::<Point>(bag, scans, "item_layout")?;
    check_layout::<ImuSample>(bag, imu, "header_layout")?;
    let truth = connection(bag, TRUTH);
    if let Some(truth) = truth {
        check_layout::<PoseFrame>(bag, truth, "header_layout")?;
    }
    tracing::info!("{}: {} scans of evac's own recorder", bag.path().display(), scans.messages);
    let mut scans = ExactScans {
        messages: Messages::new(bag, &[scans.id]),
        total: scans.messages,
        read: 0,
        last_end_ns: -LAST_TIME,
        truths: Messages::new(bag, &truth.map(|truth| truth.id).into_iter().collect::<Vec<_>>()),
        next_truth: None,
        truth: None,
        late: 0,
        rejected: 0,
    };
    scans.read_truth().map_err(file)?;
    let imu = ExactImu { messages: Messages::new(bag, &[imu.id]), last_ns: -LAST_TIME, late: 0, rejected: 0 };
    Ok(Some(Recording { scans: Box::new(scans), imu: Box::new(imu) }))
}

fn connection<'a>(bag: &'a Bag, topic: &str) -> Option<&'a Connection> {
    let is_frames = |connection: &&Connection| {
        connection.topic == topic && connection.encoding == Encoding::Cdr && connection.messages > 0
    };
    bag.connections().iter().find(is_frames)
}

/// Two builds that disagree about a layout do not understand each other's frames.
fn check_layout<T: Layout>(bag: &Bag, connection: &Connection, key: &str) -> Result<(), StageError> {
    let own = format!("{} {} {:016x}", T::NAME, size_of::<T>(), layout_hash::<T>());
    let recorded = connection.metadata.get(key).map_or("no layout", String::as_str);
    if recorded == own {
        return Ok(());
    }
    Err(StageError::File(format!(
        "{}: {} was recorded with {recorded}, this build has {own}; replay it with the build that recorded it, or set \
         lidar_topic = \"/lidar/scan\" and imu_topic = \"/imu/sample\"",
        bag.path().display(),
        connection.topic
    )))
}

/// A frame's header and what follows it.
fn parse<'a, T: Pod>(message: &BagMessage<'a>) -> Result<(T, &'a [u8]), String> {
    let bytes = octets(message.data, Encoding::Cdr).map_err(|cause| cause.to_string())?;
    let (header, rest) = bytes
        .split_at_checked(size_of::<T>())
        .ok_or_else(|| format!("{} bytes are fewer than a header's {}", bytes.len(), size_of::<T>()))?;
    Ok((bytemuck::pod_read_unaligned(header), rest))
}

struct ExactScans {
    messages: Messages,
    total: u64,
    read: u64,
    last_end_ns: i64,
    truths: Messages,
    next_truth: Option<PoseFrame>,
    /// Truth of the scan that was read last.
    truth: Option<PoseFrame>,
    late: u64,
    rejected: u64,
}

impl ScanStream for ExactScans {
    fn next_scan(&mut self, points: &mut Vec<Point>) -> Result<Option<ScanHeader>, FormatError> {
        while let Some(message) = self.messages.next_message()? {
            let offset = message.offset;
            let parsed = parse_scan(&message, points);
            let bad = |cause: String| bad_message(self.messages.path(), offset, SCANS, &cause);
            let mut header = parsed.map_err(bad)?;
            self.read += 1;
            if header.frame.end_ns < self.last_end_ns {
                self.late += 1;
                continue;
            }
            self.last_end_ns = header.frame.end_ns;
            self.rejected += reject(points);
            // A recording that was stopped has no last scan that says so.
            header.frame.flags &= !frame_flags::END_OF_STREAM;
            if self.read == self.total {
                header.frame.flags |= frame_flags::END_OF_STREAM;
            }
            self.find_truth(header.frame.seq)?;
            return Ok(Some(header));
        }
        Ok(None)
    }

    fn total(&self) -> u64 {
        self.total
    }

    fn counters(&self) -> Counters {
        Counters { late: self.late, rejected: self.rejected, ..Counters::default() }
    }

    fn truth(&self) -> Option<PoseFrame> {
        self.truth
    }
}

impl ExactScans {
    /// The truth of the scan with that number when it was recorded.
    fn find_truth(&mut self, seq: u64) -> Result<(), FormatError> {
        while self.next_truth.is_some_and(|truth| truth.frame.seq < seq) {
            self.read_truth()?;
        }
        self.truth = self.next_truth.filter(|truth| truth.frame.seq == seq);
        Ok(())
    }

    fn read_truth(&mut self) -> Result<(), FormatError> {
        self.next_truth = match self.truths.next_message()? {
            None => None,
            Some(message) => {
                let offset = message.offset;
                let parsed = parse(&message).map(|(truth, _)| truth);
                let bad = |cause: String| bad_message(self.truths.path(), offset, TRUTH, &cause);
                Some(parsed.map_err(bad)?)
            }
        };
        Ok(())
    }
}

fn parse_scan(message: &BagMessage<'_>, points: &mut Vec<Point>) -> Result<ScanHeader, String> {
    let (header, rest): (ScanHeader, _) = parse(message)?;
    let (items, remainder) = rest.as_chunks::<{ size_of::<Point>() }>();
    if !remainder.is_empty() || items.len() != header.points as usize {
        return Err(format!("{} bytes are not the {} points of its header", rest.len(), header.points));
    }
    let (start, end) = (header.frame.start_ns, header.frame.end_ns);
    if start > end || start < -LAST_TIME || end > LAST_TIME {
        return Err(format!("it lasts from {start} to {end} ns"));
    }
    points.clear();
    points.extend(items.iter().map(|bytes| bytemuck::pod_read_unaligned::<Point>(bytes)));
    Ok(header)
}

/// Points that are not finite cannot have been recorded, only damaged; they become shots without return.
fn reject(points: &mut [Point]) -> u64 {
    let mut rejected = 0;
    for point in points.iter_mut().filter(|point| !point.is_finite()) {
        *point = point.moved_to(0.0, 0.0, 0.0);
        rejected += 1;
    }
    rejected
}

struct ExactImu {
    messages: Messages,
    last_ns: i64,
    late: u64,
    rejected: u64,
}

impl ImuStream for ExactImu {
    fn next_sample(&mut self) -> Result<Option<ImuSample>, FormatError> {
        while let Some(message) = self.messages.next_message()? {
            let offset = message.offset;
            let parsed = parse(&message).map(|(sample, _): (ImuSample, _)| sample);
            let bad = |cause: String| bad_message(self.messages.path(), offset, IMU, &cause);
            let mut sample = parsed.map_err(bad)?;
            let last = sample.flags & frame_flags::END_OF_STREAM != 0;
            sample.flags &= !frame_flags::END_OF_STREAM;
            if sample.stamp_ns <= self.last_ns {
                // The run loop's word that no later sample comes repeats the last one; it will say it again.
                self.late += u64::from(!last);
                continue;
            }
            let finite = sample.gyro.iter().chain(&sample.accel).all(|value| value.is_finite());
            if !finite || sample.stamp_ns > LAST_TIME {
                self.rejected += 1;
                continue;
            }
            self.last_ns = sample.stamp_ns;
            return Ok(Some(sample));
        }
        Ok(None)
    }

    fn counters(&self) -> Counters {
        Counters { late: self.late, rejected: self.rejected, ..Counters::default() }
    }
}
