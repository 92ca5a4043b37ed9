//! From packets that have come to scans and samples: whose they are, when they were measured, what they belong to.

use std::net::{Ipv4Addr, UdpSocket};

use evac_formats::livox_sdk1::ImuRecord;
use evac_frames::{FrameHeader, ImuSample, ScanHeader, frame_flags};
use evac_stage::{LidarOutput, RawScanOutput, Reporter, StageError};

use crate::assembly::{Arrived, Assembly, Scan};
use crate::own_imu::{OwnImu, is_finite};
use crate::packet::{Packet, TimeSource};
use crate::points::Points;
use crate::rate::ShotTime;
use crate::receive::{BATCH, Received, receive};
use crate::session::View;
use crate::store::{SLOTS, Store};
use crate::timeline::{Timeline, Verdict};
use crate::{Config, PacketCounts};

/// A scan whose packets stay away for so long after its end is passed on as it is.
const GRACE_NS: i64 = 100_000_000;
/// Until so shortly before a scan is complete, packets are left to pile up: one wake-up for each would cost more than they.
const PILE_NS: i64 = 4_000_000;
/// Year 2116: later stamps are damaged, and sums of earlier ones stay far from the limits of `i64`.
const LAST_STAMP_NS: i64 = 1 << 62;

/// Where scans and samples go, and the first thing that went wrong there.
pub(crate) struct Outlet<'a> {
    pub(crate) output: &'a mut LidarOutput,
    pub(crate) reporter: &'a mut Reporter,
    pub(crate) result: Result<(), StageError>,
}

/// Packets, until they are scans and samples.
#[derive(Debug)]
pub(crate) struct Intake {
    config: Config,
    store: Store,
    received: Vec<Received>,
    timeline: Timeline,
    shot_time: ShotTime,
    assembly: Assembly,
    own_imu: OwnImu,
    counts: PacketCounts,
    /// The device of the newest session, or the one that was named.
    device: Option<Ipv4Addr>,
    /// Sessions whose data was looked at.
    sessions: u64,
    /// When the newest packet came, and the newest of the IMU; 0 before the first.
    pub(crate) data_ns: i64,
    pub(crate) imu_ns: i64,
    /// End of the last scan on the host's clock.
    end_ns: Option<i64>,
}

impl Intake {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            store: Store::new(),
            received: Vec::with_capacity(BATCH),
            timeline: Timeline::new(),
            shot_time: ShotTime::default(),
            assembly: Assembly::new(config.frame_ns(), RawScanOutput::MAX_POINTS, SLOTS - 2 * BATCH),
            own_imu: OwnImu::default(),
            counts: PacketCounts::default(),
            device: config.device,
            sessions: 0,
            data_ns: 0,
            imu_ns: 0,
            end_ns: None,
            config: config.clone(),
        }
    }

    pub(crate) fn counts(&self) -> PacketCounts {
        PacketCounts {
            lost: self.assembly.lost,
            imu_lost: self.own_imu.lost,
            segments: self.timeline.segments,
            ..self.counts
        }
    }

    /// Counts a control datagram that was not understood.
    pub(crate) fn refuse(&mut self, is_stranger: bool) {
        *(if is_stranger { &mut self.counts.strangers } else { &mut self.counts.damaged }) += 1;
    }

    /// How long packets may pile up, while they flow and the scan is not nearly complete.
    pub(crate) fn pile_ns(&self, now: i64) -> Option<i64> {
        let due_ns = self.timeline.host_ns(self.assembly.due_ns()?)?;
        let left_ns = due_ns - now - PILE_NS / 2;
        (left_ns > PILE_NS / 2 && now - self.data_ns < 5 * PILE_NS).then(|| left_ns.min(PILE_NS))
    }

    pub(crate) fn until_given_up_ns(&self, now: i64) -> i64 {
        let due_ns = self.assembly.due_ns().and_then(|due| self.timeline.host_ns(due));
        due_ns.map_or(i64::MAX, |due_ns| (due_ns + GRACE_NS - now).max(0))
    }

    /// Takes all data packets that have come.
    pub(crate) fn take_in(&mut self, socket: &UdpSocket, view: &View, outlet: &mut Outlet<'_>) {
        // Between two sessions the device is still known.
        self.device = view.device.or(self.device);
        // Bounded, so that a flood leaves time for the session.
        for _ in 0..SLOTS / BATCH {
            let mut received = std::mem::take(&mut self.received);
            received.clear();
            let got = receive(socket, &mut self.store, &mut received);
            for packet in &received {
                if !self.take_packet(packet, view.sessions, outlet) {
                    self.store.give_back(packet.slot);
                }
            }
            self.received = received;
            // An error is of an earlier sending; what has come, comes.
            if got.unwrap_or(0) < BATCH {
                break;
            }
        }
    }

    /// Handles a data packet; whether it is kept for a scan.
    fn take_packet(&mut self, received: &Received, sessions: u64, outlet: &mut Outlet<'_>) -> bool {
        if self.device != Some(*received.from.ip()) {
            self.counts.strangers += 1;
            return false;
        }
        if sessions != self.sessions {
            self.sessions = sessions;
            self.begin_session(outlet);
        }
        let Some(packet) = Packet::parse(self.config.protocol, self.store.packet(received.slot))
            .filter(|packet| !received.cut && packet.stamp_ns() < LAST_STAMP_NS)
        else {
            self.counts.damaged += 1;
            return false;
        };
        self.data_ns = received.arrival_ns.max(self.data_ns);
        if packet.is_imu() {
            let (record, source, stamp_ns) = (packet.imu(), packet.time_source(), packet.stamp_ns());
            self.take_sample(record, (source, stamp_ns, received.arrival_ns), outlet);
            return false;
        }
        let (stamp_ns, shots, source) = (packet.stamp_ns(), packet.shots(), packet.time_source());
        self.shot_time.seen(stamp_ns, shots);
        let shot_ns = packet.shot_ns().unwrap_or_else(|| self.shot_ns());
        let points = shots * packet.echoes();
        let length_ns = (shots as f64 * shot_ns).round() as i64;
        if self.timeline.leaves(source) {
            tracing::warn!(?source, "the LiDAR's clock has changed its source: a new segment begins");
            self.begin_segment(outlet);
        }
        let place_ns = match self.timeline.judge(source, stamp_ns, length_ns, received.arrival_ns) {
            Verdict::Accept(place_ns) => place_ns,
            Verdict::NewSegment => {
                tracing::warn!(stamp_ns, "the LiDAR's clock was set: a new segment begins");
                self.begin_segment(outlet);
                self.counts.unsure += 1;
                return false;
            }
            Verdict::Late => {
                self.counts.late += 1;
                return false;
            }
            Verdict::Unsure => {
                self.counts.unsure += 1;
                return false;
            }
        };
        let arrived =
            Arrived { slot: received.slot, place_ns, length_ns, points, arrival_ns: received.arrival_ns };
        if self.assembly.is_too_late(&arrived) {
            self.counts.late += 1;
            return false;
        }
        if self.assembly.is_too_early(&arrived) {
            self.counts.unsure += 1;
            return false;
        }
        if self.assembly.is_complete_before(&arrived) {
            self.complete(outlet);
        }
        self.counts.used += 1;
        if self.assembly.add(&arrived) {
            self.complete(outlet);
        }
        true
    }

    /// The device may be another, and was perhaps switched off: nothing of its clock is known.
    fn begin_session(&mut self, outlet: &mut Outlet<'_>) {
        self.begin_segment(outlet);
        self.timeline.restart();
        self.shot_time.forget();
    }

    /// The device's line begins anew, perhaps before where it was: what was expected on it says nothing about what comes.
    fn begin_segment(&mut self, outlet: &mut Outlet<'_>) {
        self.complete(outlet);
        self.assembly.forget_expected();
        self.own_imu.pause();
    }

    fn shot_ns(&self) -> f64 {
        self.config.shot_ns.map_or_else(|| self.shot_time.nanoseconds(), f64::from)
    }

    /// Passes a scan on whose last packets do not come.
    pub(crate) fn give_up(&mut self, now: i64, outlet: &mut Outlet<'_>) {
        let Some(due_ns) = self.assembly.due_ns() else { return };
        if self.timeline.host_ns(due_ns).is_some_and(|host_ns| now >= host_ns + GRACE_NS) {
            self.assembly.give_up(due_ns);
            self.complete(outlet);
        }
    }

    /// Publishes the scan that has begun.
    fn complete(&mut self, outlet: &mut Outlet<'_>) {
        let scan = self.assembly.take();
        if let Some(header) = self.header(&scan) {
            outlet.reporter.begin();
            let mut points = Points::new(self.config.protocol, &self.store, &scan.packets, self.shot_ns());
            match outlet.output.scans.publish(header, |_| points.next()) {
                Ok(header) => {
                    self.end_ns = Some(header.frame.end_ns);
                    outlet.reporter.done(&header.frame, header.frame.arrival_ns);
                }
                Err(error) => outlet.result = Err(error),
            }
            outlet.reporter.counters.degraded += u64::from(scan.lost > 0);
        }
        for held in &scan.packets {
            self.store.give_back(held.slot);
        }
        self.assembly.recycle(scan);
    }

    /// The header of a scan; `None` for an empty one.
    fn header(&self, scan: &Scan) -> Option<ScanHeader> {
        if scan.packets.is_empty() {
            return None;
        }
        // A scan goes on where the one before has ended: corrections of the clock fit stretch it a little.
        let start_ns = self.timeline.host_ns(scan.start_ns)?;
        let near = |end: &i64| (start_ns - *end).abs() < self.config.frame_ns() / 20;
        let start_ns = self.end_ns.filter(near).unwrap_or(start_ns);
        let end_ns = self.timeline.host_ns(scan.end_ns)?.max(start_ns);
        let frame = FrameHeader { start_ns, end_ns, arrival_ns: scan.arrival_ns, ..FrameHeader::default() };
        Some(ScanHeader {
            frame,
            points: scan.points as u32,
            lost_packets: scan.lost,
            ..ScanHeader::default()
        })
    }

    /// Passes a sample of the device's own IMU on, if it is wanted and its time is known: source of its clock, stamp and arrival.
    fn take_sample(
        &mut self,
        record: Option<ImuRecord>,
        (source, stamp_ns, arrival_ns): (TimeSource, i64, i64),
        outlet: &mut Outlet<'_>,
    ) {
        self.imu_ns = self.data_ns;
        self.counts.imu += 1;
        if !self.config.publish_imu {
            return;
        }
        let Some(record) = record.filter(is_finite) else {
            self.counts.damaged += 1;
            return;
        };
        let Some(stamp_ns) = self.timeline.host_ns_of(source, stamp_ns, arrival_ns) else {
            self.counts.unsure += 1;
            return;
        };
        match self.own_imu.sample(&record, stamp_ns, arrival_ns) {
            Some(sample) => {
                if let Err(error) = outlet.output.imu.publish(&sample) {
                    outlet.result = Err(error);
                }
            }
            None => self.counts.late += 1,
        }
    }

    /// The sample that says that no more will come.
    pub(crate) fn last_sample(&self) -> ImuSample {
        ImuSample { flags: frame_flags::END_OF_STREAM, ..self.own_imu.newest() }
    }
}
