//! Everything about each scan.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, PoseFrame, Route, ScanHeader};
use evac_ports::services::{ScanDeskewed, TruthPose};
use evac_ports::{Bus, FrameSample, Listener, PortError, RecordSubscriber};

use super::gated::{GatedFrames, GatedRecords};
use super::map::{MapSample, MapStream};
use super::plan::{PoseQueue, position_only};
use super::salvage::{Before, Salvage};
use super::{Join, JoinOptions, MAX_HELD};
use crate::{InputCounters, MapMessage, Reporter, SinkInput};

/// True poses kept: they come first, ahead of the scan by the whole pipeline.
const MAX_TRUTH: usize = 4 * MAX_HELD;

/// Joins map updates with scan, pose and truth of the same sequence number.
#[derive(Debug)]
pub struct SinkJoin {
    map: MapStream,
    poses: PoseQueue,
    scans: GatedFrames<ScanDeskewed>,
    truth_port: RecordSubscriber<TruthPose>,
    held: VecDeque<FrameSample<ScanDeskewed>>,
    truth: VecDeque<PoseFrame>,
    salvage: Salvage,
    patience_ns: i64,
}

impl Join for SinkJoin {
    const SERVICES: &'static [&'static str] =
        &["map/update", "map/snapshot", "odometry/pose", "scan/deskewed", "truth/pose"];
    type Frame<'a> = SinkInput<'a>;

    fn open(bus: &Bus, options: JoinOptions) -> Result<(Self, Vec<Listener>), PortError> {
        let (poses, _) = GatedRecords::open(bus)?;
        let (scans, _) = GatedFrames::open(bus)?;
        let (truth_port, _) = RecordSubscriber::open(bus)?;
        let (map, listeners) = MapStream::open(bus)?;
        let join = Self {
            map,
            poses: PoseQueue::new(poses),
            scans,
            truth_port,
            held: VecDeque::with_capacity(MAX_HELD + 1),
            truth: VecDeque::with_capacity(MAX_TRUTH + 1),
            salvage: Salvage::default(),
            patience_ns: options.patience_ns,
        };
        Ok((join, listeners.into()))
    }

    fn route(&mut self, route: &Route) {
        self.map.route(route);
        self.poses.route(route);
        self.scans.route(route);
    }

    fn limit(&mut self, seq: u64) {
        self.map.limit(seq);
    }

    fn waits(&self) -> bool {
        self.map.waits()
    }

    fn front(&self) -> Option<u64> {
        self.map.front().map(MapSample::seq)
    }

    fn take_in(&mut self, reporter: &mut Reporter) -> Result<(), PortError> {
        // The map first: it is published last, so the partners of every update taken here are here too.
        self.map.take_in(reporter)?;
        self.poses.take_in()?;
        self.take_scans()?;
        while let Some(truth) = self.truth_port.receive()? {
            self.truth.push_back(truth);
            if self.truth.len() > MAX_TRUTH {
                self.truth.pop_front();
            }
        }
        Ok(())
    }

    fn next<R>(
        &mut self,
        reporter: &mut Reporter,
        process: impl FnOnce(Self::Frame<'_>, &FrameHeader, &mut Reporter) -> R,
    ) -> Option<R> {
        let reaches = |last| {
            let scans = self.held.back().is_some_and(|scan| scan.header().frame.seq >= last);
            scans && self.poses.reaches(last)
        };
        match self.salvage.before(&self.map, reaches) {
            Before::Nothing => {}
            Before::Wait => return None,
            Before::Frame { from, last, header } => {
                if let Some(pose) = self.poses.first_of(from, last) {
                    let header = self.salvage.header(&header, &pose);
                    let scan = self.scan_of(header.frame.seq);
                    reporter.input.late += u64::from(scan.is_none());
                    let without_scan = ScanHeader { frame: header.frame, ..ScanHeader::default() };
                    let input = SinkInput {
                        header: scan.as_ref().map_or(&without_scan, FrameSample::header),
                        points: scan.as_ref().map_or(&[], FrameSample::items),
                        pose: &pose,
                        map: MapMessage { header: &header, voxels: &[] },
                        truth: self.truth.front().filter(|truth| truth.frame.seq == header.frame.seq),
                    };
                    return Some(process(input, &header.frame, reporter));
                }
            }
        }
        let sample = self.map.next()?;
        self.salvage.end();
        let frame = sample.header().frame;
        let pose = self.poses.at(frame.seq);
        let scan = self.scan_of(frame.seq);
        let is_whole = scan.is_some() && pose.is_some();
        reporter.input.late += u64::from(!is_whole && !sample.is_snapshot());
        let pose = pose.unwrap_or_else(|| position_only(sample.header()));
        let without_scan = ScanHeader { frame, ..ScanHeader::default() };
        let input = SinkInput {
            header: scan.as_ref().map_or(&without_scan, FrameSample::header),
            points: scan.as_ref().map_or(&[], FrameSample::items),
            pose: &pose,
            map: sample.message(),
            truth: self.truth.front().filter(|truth| truth.frame.seq == frame.seq),
        };
        Some(process(input, &frame, reporter))
    }

    fn resume(&mut self, after: Option<u64>) {
        self.map.resume();
        self.salvage.resume(after, self.patience_ns);
    }

    fn done(&mut self, frame: &FrameHeader) -> Option<FrameHeader> {
        self.salvage.done(frame)
    }

    fn deadline_ns(&self) -> Option<i64> {
        self.salvage.deadline_ns(&self.map)
    }
}

impl SinkJoin {
    /// Takes scans as far as there is room; where there is none, those that no update will come for make some. Not before: they may still
    /// be wanted, where this instance is about to go on from the journal of one that was killed.
    fn take_scans(&mut self) -> Result<(), PortError> {
        let first = self.salvage.first(&self.map).unwrap_or(0);
        loop {
            if self.held.len() == MAX_HELD {
                if self.held.front().is_none_or(|scan| scan.header().frame.seq >= first) {
                    return Ok(());
                }
                self.held.pop_front();
            }
            // What is missing is counted where it would have been joined.
            let Some(scan) = self.scans.receive(&mut InputCounters::default())? else { return Ok(()) };
            self.held.push_back(scan);
        }
    }

    fn pass_scans(&mut self, seq: u64) {
        while self.held.front().is_some_and(|scan| scan.header().frame.seq < seq) {
            self.held.pop_front();
        }
    }

    /// The scan with that number, where it has come; older scans and true poses are done with.
    fn scan_of(&mut self, seq: u64) -> Option<FrameSample<ScanDeskewed>> {
        self.pass_scans(seq);
        while self.truth.front().is_some_and(|truth| truth.frame.seq < seq) {
            self.truth.pop_front();
        }
        let has_scan = self.held.front().is_some_and(|scan| scan.header().frame.seq == seq);
        if has_scan { self.held.pop_front() } else { None }
    }
}
