//! The driver: sockets, session, clock and scans put together.

use std::net::Ipv4Addr;
use std::time::Duration;

use evac_frames::{FrameHeader, ScanHeader};
use evac_stage::{Device, RawScanOutput, Reporter, Rig, StageConfig as _, StageError};
use rustix::time::ClockId;

use crate::Config;
use crate::assembly::{Arrived, Assembly, Scan};
use crate::condition::Condition;
use crate::packet::Packet;
use crate::points::Points;
use crate::rate::ShotTime;
use crate::receive::{BATCH, Received, nanoseconds, receive};
use crate::session::{Host, Outbox, Phase, SECOND, Session};
use crate::sockets::Sockets;
use crate::store::{SLOTS, Store};
use crate::timeline::{Timeline, Verdict};

/// A scan whose packets stay away for so long after its end is passed on as it is.
const GRACE_NS: i64 = 100_000_000;
/// Until so shortly before a scan is complete, packets are left to pile up: one wake-up for each would cost more than they.
const PILE_NS: i64 = 4_000_000;
/// Year 2116: later stamps are damaged, and sums of earlier ones stay far from the limits of `i64`.
const LAST_STAMP_NS: i64 = 1 << 62;
/// No data for so long is worth saying.
const QUIET_NS: i64 = SECOND;

/// What was done with packets since the start.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct PacketCounts {
    /// Packets of points that went into scans.
    pub used: u64,
    /// Packets of the device's own IMU, which are not passed on.
    pub imu: u64,
    /// Packets that never came, told by the time between their neighbours.
    pub lost: u64,
    /// Packets that came twice or were overtaken.
    pub late: u64,
    /// Packets from other addresses than the device's.
    pub strangers: u64,
    /// Packets of the device that are none, or whose checksum is wrong, and control datagrams likewise.
    pub damaged: u64,
    /// Packets left out because their time was not known (while the clock is being fitted, or with a damaged stamp), or because
    /// they came before the first whole scan.
    pub unsure: u64,
    /// Times that the device's clock was set or has changed its source.
    pub segments: u64,
}

/// A Livox LiDAR; publishes `lidar/scan` on the host's monotonic clock.
#[derive(Debug)]
pub struct Lidar {
    config: Config,
    sockets: Option<Sockets>,
    session: Option<Session>,
    outbox: Outbox,
    store: Store,
    received: Vec<Received>,
    timeline: Timeline,
    shot_time: ShotTime,
    assembly: Assembly,
    counts: PacketCounts,
    condition: Condition,
    /// The device of the newest session, or the one that was named.
    device: Option<Ipv4Addr>,
    /// Sessions whose data was looked at.
    sessions: u64,
    data_ns: i64,
    /// End of the last scan on the host's clock.
    end_ns: Option<i64>,
    described_ns: i64,
    tick_ns: i64,
}

impl Device for Lidar {
    const NAME: &'static str = "lidar";
    type Config = Config;
    type Output = RawScanOutput;

    fn new(config: Config, _rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let assembly = Assembly::new(config.frame_ns(), RawScanOutput::MAX_POINTS, SLOTS - 2 * BATCH);
        Ok(Self {
            sockets: None,
            session: None,
            outbox: Outbox::default(),
            store: Store::new(),
            received: Vec::with_capacity(BATCH),
            timeline: Timeline::new(),
            shot_time: ShotTime::default(),
            assembly,
            counts: PacketCounts::default(),
            condition: Condition::default(),
            device: config.device,
            sessions: 0,
            data_ns: 0,
            end_ns: None,
            described_ns: 0,
            tick_ns: 0,
            config,
        })
    }

    fn serve(
        &mut self,
        output: &mut RawScanOutput,
        reporter: &mut Reporter,
        patience: Duration,
    ) -> Result<(), StageError> {
        let Some(sockets) = self.sockets.take() else { return self.open(reporter, patience) };
        let served = self.serve_with(&sockets, output, reporter, patience);
        self.sockets = Some(sockets);
        served
    }

    fn finish(&mut self, _output: &mut RawScanOutput) -> Result<(), StageError> {
        if let (Some(sockets), Some(session), true) =
            (&self.sockets, &mut self.session, self.config.stop_at_exit)
        {
            session.end(&mut self.outbox);
            send(&mut self.outbox, sockets);
        }
        Ok(())
    }
}

impl Lidar {
    /// What was done with packets since the start.
    pub fn counts(&self) -> PacketCounts {
        PacketCounts { lost: self.assembly.lost, segments: self.timeline.segments, ..self.counts }
    }

    /// Port of this computer that the device sends data to, once the sockets are open.
    pub fn data_port(&self) -> Option<u16> {
        self.sockets.as_ref().map(Sockets::data_port)
    }

    /// Port of this computer for commands, once the sockets are open.
    pub fn command_port(&self) -> Option<u16> {
        self.sockets.as_ref().map(Sockets::command_port)
    }

    /// Opens the sockets; the network may come up later than this process.
    fn open(&mut self, reporter: &mut Reporter, patience: Duration) -> Result<(), StageError> {
        match Sockets::open(&self.config) {
            Ok(sockets) => {
                tracing::info!(
                    interface = %self.config.interface,
                    data_port = sockets.data_port(),
                    receive_buffer = sockets.receive_buffer(),
                    "listening"
                );
                let host = Host {
                    address: self.config.interface,
                    command_port: sockets.command_port(),
                    data_port: sockets.data_port(),
                };
                self.session = Some(Session::new(&self.config, host));
                self.sockets = Some(sockets);
            }
            Err(error) => {
                let text = error.to_string();
                if reporter.noted().is_empty() || !text.starts_with(&reporter.noted()) {
                    tracing::warn!("{text}");
                    reporter.note(&text);
                }
                std::thread::sleep(patience);
            }
        }
        Ok(())
    }

    fn serve_with(
        &mut self,
        sockets: &Sockets,
        output: &mut RawScanOutput,
        reporter: &mut Reporter,
        patience: Duration,
    ) -> Result<(), StageError> {
        let now = nanoseconds(ClockId::Monotonic);
        let until_tick = self.tick_ns.saturating_sub(now).max(0);
        let (pause_ns, with_data) = match self.pile_ns(now) {
            Some(pile_ns) => (pile_ns, false),
            None => (self.until_given_up_ns(now), true),
        };
        let pause = Duration::from_nanos(until_tick.min(pause_ns).unsigned_abs()).min(patience);
        sockets.wait(pause, with_data);
        let now = nanoseconds(ClockId::Monotonic);
        self.control(sockets, now);
        self.data(sockets, output, reporter)?;
        self.give_up(now, output, reporter)?;
        if now >= self.tick_ns
            && let Some(session) = &mut self.session
        {
            self.tick_ns = session.tick(now, self.data_ns, &mut self.outbox);
            send(&mut self.outbox, sockets);
        }
        self.report(now, reporter);
        Ok(())
    }

    /// How long packets may pile up, while they flow and the scan is not nearly complete.
    fn pile_ns(&self, now: i64) -> Option<i64> {
        let due_ns = self.timeline.host_ns(self.assembly.due_ns()?)?;
        let left_ns = due_ns - now - PILE_NS / 2;
        (left_ns > PILE_NS / 2 && now - self.data_ns < 5 * PILE_NS).then(|| left_ns.min(PILE_NS))
    }

    fn until_given_up_ns(&self, now: i64) -> i64 {
        let due_ns = self.assembly.due_ns().and_then(|due| self.timeline.host_ns(due));
        due_ns.map_or(i64::MAX, |due_ns| (due_ns + GRACE_NS - now).max(0))
    }

    /// Takes all control datagrams that have come.
    fn control(&mut self, sockets: &Sockets, now: i64) {
        let Some(session) = &mut self.session else { return };
        let before = session.view();
        let mut buffer = [0; 2048];
        // A flood is no reason to forget the data.
        for _ in 0..BATCH {
            let Some((from, bytes)) = sockets.receive(&mut buffer) else { break };
            let device = session.view().device.or(self.config.device);
            if !session.receive(now, from, bytes, &mut self.outbox) {
                let stranger = device.is_some_and(|device| device != *from.ip());
                *(if stranger { &mut self.counts.strangers } else { &mut self.counts.damaged }) += 1;
            }
        }
        if session.view() != before {
            self.tick_ns = now;
        }
        send(&mut self.outbox, sockets);
    }

    /// Takes all data packets that have come.
    fn data(
        &mut self,
        sockets: &Sockets,
        output: &mut RawScanOutput,
        reporter: &mut Reporter,
    ) -> Result<(), StageError> {
        // Bounded, so that a flood leaves time for the session.
        for _ in 0..SLOTS / BATCH {
            let mut received = std::mem::take(&mut self.received);
            received.clear();
            let got = receive(&sockets.data, &mut self.store, &mut received);
            let mut result = Ok(());
            for packet in &received {
                if !self.take_packet(packet, output, reporter, &mut result) {
                    self.store.give_back(packet.slot);
                }
            }
            self.received = received;
            result?;
            // An error is of an earlier sending; what has come, comes.
            if got.unwrap_or(0) < BATCH {
                break;
            }
        }
        Ok(())
    }

    /// Handles a data packet; whether it is kept for a scan.
    fn take_packet(
        &mut self,
        received: &Received,
        output: &mut RawScanOutput,
        reporter: &mut Reporter,
        result: &mut Result<(), StageError>,
    ) -> bool {
        let view = self.session.as_ref().map(Session::view);
        // Between two sessions the device is still known.
        self.device = view.and_then(|view| view.device).or(self.device);
        let Some(view) = view.filter(|_| self.device == Some(*received.from.ip())) else {
            self.counts.strangers += 1;
            return false;
        };
        if view.sessions != self.sessions {
            // The device may be another, and was perhaps switched off: nothing of its clock is known.
            self.sessions = view.sessions;
            self.complete(output, reporter, result);
            self.timeline.restart();
            self.assembly.forget_expected();
            self.shot_time.forget();
        }
        let Some(packet) = Packet::parse(self.config.protocol, self.store.packet(received.slot))
            .filter(|packet| !received.cut && packet.stamp_ns() < LAST_STAMP_NS)
        else {
            self.counts.damaged += 1;
            return false;
        };
        self.data_ns = received.arrival_ns.max(self.data_ns);
        if packet.imu().is_some() {
            self.counts.imu += 1;
            return false;
        }
        let (stamp_ns, shots, source) = (packet.stamp_ns(), packet.shots(), packet.time_source());
        self.shot_time.seen(stamp_ns, shots);
        let shot_ns = packet.shot_ns().unwrap_or_else(|| self.shot_ns());
        let points = shots * packet.echoes();
        let length_ns = (shots as f64 * shot_ns).round() as i64;
        let place_ns = match self.timeline.judge(source, stamp_ns, length_ns, received.arrival_ns) {
            Verdict::Accept(place_ns) => place_ns,
            Verdict::NewSegment => {
                tracing::warn!(stamp_ns, "the LiDAR's clock was set: a new segment begins");
                self.complete(output, reporter, result);
                self.assembly.forget_expected();
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
        if self.assembly.is_too_early(&arrived) {
            self.counts.unsure += 1;
            return false;
        }
        if self.assembly.is_complete_before(&arrived) {
            self.complete(output, reporter, result);
        }
        self.counts.used += 1;
        if self.assembly.add(&arrived) {
            self.complete(output, reporter, result);
        }
        true
    }

    fn shot_ns(&self) -> f64 {
        self.config.shot_ns.map_or_else(|| self.shot_time.nanoseconds(), f64::from)
    }

    /// Passes a scan on whose last packets do not come.
    fn give_up(
        &mut self,
        now: i64,
        output: &mut RawScanOutput,
        reporter: &mut Reporter,
    ) -> Result<(), StageError> {
        let Some(due_ns) = self.assembly.due_ns() else { return Ok(()) };
        if self.timeline.host_ns(due_ns).is_none_or(|host_ns| now < host_ns + GRACE_NS) {
            return Ok(());
        }
        self.assembly.give_up(due_ns);
        let mut result = Ok(());
        self.complete(output, reporter, &mut result);
        result
    }

    /// Publishes the scan that has begun.
    fn complete(
        &mut self,
        output: &mut RawScanOutput,
        reporter: &mut Reporter,
        result: &mut Result<(), StageError>,
    ) {
        let scan = self.assembly.take();
        if let Some(header) = self.header(&scan) {
            reporter.begin();
            let mut points = Points::new(self.config.protocol, &self.store, &scan.packets, self.shot_ns());
            match output.publish(header, |_| points.next()) {
                Ok(header) => {
                    self.end_ns = Some(header.frame.end_ns);
                    reporter.done(&header.frame, header.frame.arrival_ns);
                }
                Err(error) => *result = Err(error),
            }
            reporter.counters.degraded += u64::from(scan.lost > 0);
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

    /// Counts and says what there is to say, now and then.
    fn report(&mut self, now: i64, reporter: &mut Reporter) {
        if now - self.described_ns < SECOND / 10 {
            return;
        }
        self.described_ns = now;
        let Some(view) = self.session.as_ref().map(Session::view) else { return };
        let counts = self.counts();
        reporter.counters.late = counts.late;
        reporter.counters.rejected = counts.strangers + counts.damaged;
        let silent = view.phase == Phase::Sampling && now - self.data_ns > QUIET_NS;
        self.condition.describe(&view, &counts, silent);
        reporter.note(&self.condition.text);
    }
}

fn send(outbox: &mut Outbox, sockets: &Sockets) {
    outbox.drain(|channel, to, bytes| {
        // A cable that is not plugged in: the session repeats itself.
        if let Err(cause) = sockets.send(channel, to, bytes) {
            tracing::debug!(%to, %cause, "cannot send");
        }
    });
}
