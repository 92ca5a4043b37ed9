//! Packets grouped into scans.

use std::path::Path;

use evac_formats::FormatError;
use evac_frames::{FrameHeader, Point, ScanHeader, frame_flags};
use evac_stage::Counters;

use super::datagram::Datagram;
use super::packets::{Kind, Packets};
use super::survey::Survey;
use crate::Config;
use crate::streams::ScanStream;

/// More points than any device sends in a scan; only a capture with made-up stamps has more, which are rejected.
const MAX_POINTS: usize = 1 << 20;

/// Scan k holds the shots of `[t0 + k P, t0 + (k + 1) P)` on the device's clock, t0 being the first packet's stamp and
/// P the period. A packet across the border is divided.
pub(super) struct CaptureScans {
    packets: Packets,
    survey: Survey,
    /// Number of the next scan.
    next: u64,
    /// The packet at hand, with shots that belong to the next scan.
    held: Option<Held>,
    /// Packets that should have been between the one at hand and the one before.
    missing: Missing,
    /// Points that were not passed on.
    rejected: u64,
}

#[derive(Debug, Clone, Copy)]
struct Held {
    stamp: i64,
    first_shot: usize,
}

#[derive(Debug, Clone, Copy, Default)]
struct Missing {
    /// Where the next packet should begin if none is lost.
    expected: Option<i64>,
    /// Begin of the first missing packet, how many are missing, and their length.
    first: i64,
    count: i64,
    length: i64,
}

impl CaptureScans {
    pub(super) fn open(path: &Path, survey: &Survey, config: &Config) -> Result<Self, FormatError> {
        let packets = Packets::of(path, survey.device, Kind::Points, config.allow_truncated)?;
        Ok(Self {
            packets,
            survey: survey.clone(),
            next: 0,
            held: None,
            missing: Missing::default(),
            rejected: 0,
        })
    }

    /// The packet at hand, or the next.
    fn packet(&mut self) -> Result<Option<Held>, FormatError> {
        if let Some(held) = self.held.take() {
            return Ok(Some(held));
        }
        let Some(stamp) = self.packets.advance()? else { return Ok(None) };
        let length =
            self.packets.datagram().map_or(0, |datagram| datagram.shots() as i64 * self.survey.shot_ns);
        self.missing.arrived(stamp, length);
        Ok(Some(Held { stamp, first_shot: 0 }))
    }
}

impl ScanStream for CaptureScans {
    fn next_scan(&mut self, points: &mut Vec<Point>) -> Result<Option<ScanHeader>, FormatError> {
        points.clear();
        let Survey { first_ns, scans, period_ns, shot_ns, .. } = self.survey;
        if self.next == scans {
            return Ok(None);
        }
        let start_ns = first_ns + period_ns * self.next as i64;
        let end_ns = start_ns + period_ns;
        self.next += 1;
        let mut header = ScanHeader {
            frame: FrameHeader { start_ns, end_ns, ..FrameHeader::default() },
            ..ScanHeader::default()
        };
        header.lost_packets = self.missing.before(end_ns);
        while let Some(Held { stamp, first_shot }) = self.packet()? {
            header.lost_packets += self.missing.before(end_ns);
            let Some(datagram) = self.packets.datagram() else { continue };
            let shots = datagram.shots();
            // Shots of this packet that are before the scan's end.
            let before_end = (end_ns - stamp).max(0).saturating_add(shot_ns - 1) / shot_ns;
            let until = usize::try_from(before_end).unwrap_or(usize::MAX).min(shots);
            add_points(&datagram, first_shot..until, stamp - start_ns, shot_ns, points, &mut header);
            if until < shots {
                self.held = Some(Held { stamp, first_shot: until.max(first_shot) });
                break;
            }
        }
        header.points = points.len() as u32;
        self.rejected += u64::from(header.rejected);
        if self.next == scans {
            header.frame.flags |= frame_flags::END_OF_STREAM;
        }
        Ok(Some(header))
    }

    fn total(&self) -> u64 {
        self.survey.scans
    }

    fn counters(&self) -> Counters {
        let (unused, file) = (self.packets.unused(), self.packets.counts());
        let rejected = unused.foreign + unused.other_devices + unused.stray + file.fragments + file.cut;
        Counters { late: unused.late, rejected: rejected + self.rejected, ..Counters::default() }
    }
}

impl Missing {
    /// Takes in a packet; a gap of more than half a packet before it is a loss.
    fn arrived(&mut self, stamp: i64, length: i64) {
        if let Some(expected) = self.expected.filter(|_| self.length > 0) {
            self.first = expected;
            self.count = (stamp - expected + self.length / 2) / self.length;
        }
        self.length = length;
        self.expected = Some(stamp + length);
    }

    /// Takes out the missing packets that should have begun before `end`.
    fn before(&mut self, end: i64) -> u32 {
        if self.count <= 0 || self.length <= 0 {
            return 0;
        }
        let before = ((end - self.first).max(0) + self.length - 1) / self.length;
        let taken = before.min(self.count);
        self.count -= taken;
        self.first += taken * self.length;
        taken as u32
    }
}

/// Adds the echoes of some shots; `since_start` is the packet's time since the scan's start.
fn add_points(
    datagram: &Datagram<'_>,
    shots: std::ops::Range<usize>,
    since_start: i64,
    shot_ns: i64,
    points: &mut Vec<Point>,
    header: &mut ScanHeader,
) {
    let echoes = datagram.echoes();
    for index in shots.start * echoes..shots.end * echoes {
        let Some(point) = datagram.point(index) else { continue };
        if points.len() == MAX_POINTS {
            header.rejected = header.rejected.saturating_add(1);
            continue;
        }
        let [x, y, z] = point.position;
        let offset = since_start + (index / echoes) as i64 * shot_ns;
        let point = Point::new(x, y, z, offset, point.reflectivity);
        header.no_return += u32::from(!point.is_return());
        points.push(point);
    }
}
