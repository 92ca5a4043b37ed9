//! The way since the start over again, once the offset between the clocks has been found.
//!
//! Until then scans are brought to their ends, and the pose is carried on, by readings of another time: in a rig that shakes, 80 ms make
//! degrees, and what is mapped from there stays askew. So the scans since the standstill are kept, and the filter goes from there through
//! all of them anew, as they were measured, with the offset that was found, as often as a better one is found.

use evac_frames::{Point, ScanHeader, scan_flags};
use evac_geometry::nalgebra::Isometry3;
use evac_stage::{Counters, ScanWithImu};

use super::deskew::Deskew;
use super::filter::Filter;
use super::initialisation::Start;
use super::offset_search::Found;
use super::propagation::TracePoint;
use super::stage::Lio;
use super::state::State;
use super::tracking::Step;

/// What is kept, 10 MB: 6 s of a Mid-40. By then the filter has mostly found by itself what a search has not; one that takes longer corrects
/// it where it stands.
const MAX_FRAMES: usize = 60;
const MAX_POINTS: usize = 600_000;
const MAX_TRACE: usize = 40 * MAX_FRAMES;

/// Times that the way is taken at most.
const MAX_ROUNDS: u32 = 8;
/// A way that was begun with an offset is of no use if the filter ends with another, farther off than this, s.
const STALE_S: f64 = 0.004;
/// Frames of a standstill that are kept: by a clock that lags the motion begins in the scans before the IMU shows it.
const LEAD: usize = 3;

/// The scans since the start, while the offset is searched for.
#[derive(Debug)]
pub(crate) struct Retake {
    /// What the filter began with, and the end of the frame before those kept; nothing where there is no way back to it.
    start: Option<(Start, i64)>,
    has_moved: bool,
    /// The way is being taken again.
    is_on: bool,
    rounds: u32,
    /// The offset that it was begun with in the last round, s.
    begun_with_s: f64,
    frames: Vec<Kept>,
    points: Vec<Point>,
    traces: Vec<TracePoint>,
}

/// One of them.
#[derive(Debug, Clone, Copy)]
struct Kept {
    header: ScanHeader,
    gap_s: f64,
    /// How many of the points are its own.
    points: usize,
    /// How many instants of the traces are on its way, and where that ended, as it seemed then.
    trace: usize,
    end: State,
}

impl Retake {
    pub(crate) fn new() -> Self {
        Self {
            start: None,
            has_moved: false,
            is_on: false,
            rounds: 0,
            begun_with_s: 0.0,
            frames: Vec::with_capacity(MAX_FRAMES),
            points: Vec::with_capacity(MAX_POINTS),
            traces: Vec::with_capacity(MAX_TRACE),
        }
    }

    /// The filter begins with `start` and this offset at the end of a frame, by the LiDAR's clock.
    pub(crate) fn open(&mut self, start: &Start, end_ns: i64, offset_s: f64) {
        (self.start, self.begun_with_s) = (Some((*start, end_ns)), offset_s);
    }

    /// There is no way back any more.
    fn close(&mut self) {
        self.start = None;
        (self.frames, self.points, self.traces) = (Vec::new(), Vec::new(), Vec::new());
    }

    /// The offset that the way is to be taken again with, s, if any: one that the search found or, once it is over or no more is kept, the filter
    /// itself.
    pub(crate) fn offset_s(&self, found: Found, filter: &Filter) -> Option<f64> {
        let own_s = filter.state.time_offset_s;
        let is_due = self.rounds > 0 || found == Found::Settled || self.frames.len() == MAX_FRAMES;
        let is_stale = is_due && (own_s - self.begun_with_s).abs() > STALE_S;
        match found {
            _ if !self.is_possible() => None,
            Found::Changed(offset_s) => Some(offset_s),
            _ => is_stale.then_some(own_s),
        }
    }

    pub(crate) fn is_open(&self) -> bool {
        self.start.is_some()
    }

    /// Whether the way can be taken again.
    pub(crate) fn is_possible(&self) -> bool {
        self.is_open() && self.rounds < MAX_ROUNDS
    }

    /// The end of the frame that the way begins with, by the LiDAR's clock.
    pub(crate) fn begin_ns(&self) -> Option<i64> {
        self.start.map(|(_, end_ns)| end_ns)
    }

    /// Room for a frame of so many points and instants; false where there is none left. As long as the rig stands, the way has not begun.
    fn make_room(&mut self, points: usize, trace: usize, at_rest: bool) -> bool {
        self.has_moved |= !at_rest;
        if let (Some((_, end_ns)), Some(first)) = (&mut self.start, self.frames.first().copied())
            && !self.has_moved
            && self.frames.len() == LEAD
        {
            *end_ns = first.header.frame.end_ns;
            self.frames.remove(0);
            self.points.drain(..first.points);
            self.traces.drain(..first.trace);
        }
        self.frames.len() < MAX_FRAMES
            && self.points.len() + points <= MAX_POINTS
            && self.traces.len() + trace <= MAX_TRACE
    }
}

/// Brings points back to where they were measured. The deskewer went by the same readings and the pose before, and so by this way.
fn undo_deskewing(frames: &mut [Kept], points: &mut [Point], traces: &[TracePoint], rig: &Isometry3<f64>) {
    let (mut points, mut traces) = (points, traces);
    for Kept { header, points: own, trace, end, .. } in frames {
        let (scan, later_points) = points.split_at_mut(*own);
        let (way, later_traces) = traces.split_at(*trace);
        (points, traces) = (later_points, later_traces);
        if header.scan_flags & scan_flags::DESKEWED != 0 {
            header.scan_flags &= !scan_flags::DESKEWED;
            let mut deskew = Deskew::new(way, end, rig);
            let start_ns = header.frame.start_ns - end.offset_ns();
            scan.iter_mut().for_each(|point| *point = deskew.undo(point, start_ns));
        }
    }
}

impl Lio {
    /// Keeps the scan while there may be a way back; `filter` is the prediction of its end from `since_ns` on, by the IMU's clock.
    pub(crate) fn keep(&mut self, filter: &Filter, input: &ScanWithImu<'_>, gap_s: f64, since_ns: i64) {
        if !self.retake.is_open() || self.retake.is_on {
            return;
        }
        let at_rest = !self.retake.has_moved && self.is_at_rest(since_ns);
        let (points, trace) = (input.points.len(), self.trace.len());
        if self.offset_search.is_over() || !self.retake.make_room(points, trace, at_rest) {
            self.forget_start();
            return;
        }
        self.retake.points.extend_from_slice(input.points);
        self.retake.traces.extend_from_slice(&self.trace);
        self.retake.frames.push(Kept { header: *input.header, gap_s, points, trace, end: filter.state });
    }

    /// There is no way back to the start any more, nor need for its points.
    pub(crate) fn forget_start(&mut self) {
        self.retake.close();
        self.still = Vec::new();
    }

    /// Goes from the start through all frames kept, with this offset between the clocks, s, or with a better one that is found on the way.
    /// Returns the filter after the last of them, and what that led to.
    pub(crate) fn take_again(
        &mut self,
        mut filter: Filter,
        mut last: Step,
        mut offset_s: f64,
    ) -> (Filter, Step) {
        let Some((start, end_ns)) = self.retake.start else { return (filter, last) };
        let (mut frames, mut points) =
            (std::mem::take(&mut self.retake.frames), std::mem::take(&mut self.retake.points));
        undo_deskewing(&mut frames, &mut points, &self.retake.traces, &self.imu_from_lidar);
        self.retake.is_on = true;
        loop {
            self.diagnostics.offset_corrections += 1;
            self.retake.rounds += 1;
            self.retake.begun_with_s = offset_s;
            let Filter { mut sections, .. } = filter;
            sections.clear();
            filter = Filter::new(&start, end_ns, &self.config, sections);
            filter.begin_with_offset(offset_s, end_ns);
            self.lay_standstill(&filter);
            let mut to_come = points.as_slice();
            for kept in &frames {
                let (points, later) = to_come.split_at(kept.points);
                to_come = later;
                let header = &kept.header;
                let input = ScanWithImu { header, points, imu: &[], imu_covers: true, prior: None };
                last = self.step(&mut filter, &input, kept.gap_s, &mut Counters::default());
                if self.retake.is_possible() && matches!(last.found, Found::Changed(_)) {
                    break;
                }
            }
            match self.retake.offset_s(last.found, &filter) {
                Some(better_s) => offset_s = better_s,
                None => break,
            }
        }
        (self.retake.frames, self.retake.points, self.retake.is_on) = (frames, points, false);
        (filter, last)
    }
}

#[cfg(test)]
mod tests {
    use evac_frames::FrameHeader;
    use evac_geometry::nalgebra::Vector3;

    use super::super::config::LioConfig;
    use super::super::sections::Sections;
    use super::super::state::Covariance;
    use super::*;

    const FRAME_NS: i64 = 100_000_000;

    fn start() -> Start {
        Start {
            state: State::at_origin(),
            covariance: Covariance::zeros(),
            accel_noise: 0.0,
            gyro_noise: 0.0,
            standing: true,
        }
    }

    fn instant() -> TracePoint {
        TracePoint { stamp_ns: 0, state: State::at_origin(), rate: Vector3::zeros() }
    }

    /// Keeps frames of `points` points, each named after its frame, until there is no room; returns how many.
    fn keep(retake: &mut Retake, from: usize, count: usize, points: usize, at_rest: bool) -> usize {
        let mut kept = 0;
        for number in from..from + count {
            if !retake.make_room(points, 20, at_rest) {
                break;
            }
            let end_ns = (number as i64 + 1) * FRAME_NS;
            let header = ScanHeader {
                frame: FrameHeader { start_ns: end_ns - FRAME_NS, end_ns, ..Default::default() },
                ..Default::default()
            };
            retake.points.extend((0..points).map(|_| Point::new(number as f32, 0.0, 0.0, 0, 0)));
            retake.traces.extend((0..20).map(|_| instant()));
            let end = State::at_origin();
            retake.frames.push(Kept { header, gap_s: 0.1, points, trace: 20, end });
            kept += 1;
        }
        kept
    }

    #[test]
    fn the_way_begins_just_before_the_first_motion_however_long_the_rig_has_stood() {
        let mut retake = Retake::new();
        retake.open(&start(), 0, 0.0);
        keep(&mut retake, 0, 1000, 100, true);
        assert_eq!(keep(&mut retake, 1000, 20, 100, false), 20);
        let first = retake.frames[0].header.frame;
        assert_eq!((retake.frames.len(), retake.points.len()), (LEAD + 20, (LEAD + 20) * 100));
        assert_eq!(retake.traces.len(), (LEAD + 20) * 20);
        assert_eq!(first.start_ns, (1000 - LEAD as i64) * FRAME_NS);
        assert_eq!(retake.begin_ns(), Some(first.start_ns));
        assert_eq!(f64::from(retake.points[0].x), 1000.0 - LEAD as f64);
        // A stop on the way belongs to it.
        assert_eq!(keep(&mut retake, 1020, 5, 100, true), 5);
        assert_eq!(retake.frames[0].header.frame, first);
    }

    #[test]
    fn what_is_kept_has_an_end_in_frames_and_in_points() {
        for (points, frames) in [(100, MAX_FRAMES), (MAX_POINTS / 4, 4)] {
            let mut retake = Retake::new();
            retake.open(&start(), 0, 0.0);
            assert_eq!(keep(&mut retake, 0, 1000, points, false), frames);
            assert!(retake.points.capacity() == MAX_POINTS && retake.frames.capacity() == MAX_FRAMES);
        }
    }

    #[test]
    fn a_filter_that_ends_with_another_offset_than_it_began_with_goes_again_but_not_for_ever() {
        let mut filter = Filter::new(&start(), 0, &LioConfig::default(), Sections::new());
        let mut retake = Retake::new();
        retake.open(&start(), 0, 0.0);
        filter.state.time_offset_s = 2.0 * STALE_S;
        assert_eq!(retake.offset_s(Found::Searching, &filter), None);
        keep(&mut retake, 0, MAX_FRAMES, 1, false);
        assert_eq!(retake.offset_s(Found::Searching, &filter), Some(2.0 * STALE_S));
        retake.frames.clear();
        assert_eq!(retake.offset_s(Found::Changed(0.03), &filter), Some(0.03));
        assert_eq!(retake.offset_s(Found::Settled, &filter), Some(2.0 * STALE_S));
        filter.state.time_offset_s = 0.5 * STALE_S;
        assert_eq!(retake.offset_s(Found::Settled, &filter), None);
        retake.rounds = MAX_ROUNDS;
        assert_eq!(retake.offset_s(Found::Changed(0.03), &filter), None);
    }
}
