//! The first protocol: broadcast, handshake, heartbeat, start.

use std::net::{Ipv4Addr, SocketAddrV4};

use evac_formats::livox_sdk1::{
    self, Broadcast, Frame, FrameKind, Frames, Reply, Request, Status, WorkState,
};

use super::{Channel, Host, LOST_NS, Lost, Outbox, Phase, SECOND, SILENT_NS, View};
use crate::{Config, ReturnMode};

/// Port of a device for commands.
const DEVICE_PORT: u16 = 65000;
/// The device ends a session without heartbeats; the vendor's software sends them so often.
const HEARTBEAT_NS: i64 = 800_000_000;
/// Time for an answer.
const ANSWER_NS: i64 = SECOND / 2;
/// Attempts after which a command that is not essential is given up.
const ATTEMPTS: u32 = 5;

/// What a device is told before it measures, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    DeviceInfo,
    Extrinsic,
    Cartesian,
    ReturnMode,
    Imu,
    Start,
}

/// The conversation.
#[derive(Debug)]
pub(crate) struct Sdk1 {
    pub(super) view: View,
    host: Host,
    /// The device that is wanted, where it was named.
    wanted: Option<Ipv4Addr>,
    serial: Option<String>,
    return_mode: Option<livox_sdk1::ReturnMode>,
    /// Whether samples of the device's own IMU are wanted.
    imu: bool,
    peer: Option<SocketAddrV4>,
    sequence: u16,
    /// The command under way: when it was sent, how often, and its number.
    sent: Option<(i64, u32, u16)>,
    step: Step,
    heartbeat_ns: i64,
    heard_ns: i64,
    started_ns: i64,
}

impl Sdk1 {
    pub(crate) fn new(config: &Config, host: Host) -> Self {
        Self {
            view: View::new(),
            host,
            wanted: config.device,
            serial: config.serial.clone(),
            return_mode: config.return_mode.map(|mode| match mode {
                ReturnMode::First => livox_sdk1::ReturnMode::First,
                ReturnMode::Strongest => livox_sdk1::ReturnMode::Strongest,
                ReturnMode::Dual => livox_sdk1::ReturnMode::Dual,
                ReturnMode::Triple => livox_sdk1::ReturnMode::Triple,
            }),
            imu: config.publish_imu,
            peer: None,
            sequence: 0,
            sent: None,
            step: Step::DeviceInfo,
            heartbeat_ns: 0,
            heard_ns: 0,
            started_ns: 0,
        }
    }

    pub(crate) fn receive(
        &mut self,
        now_ns: i64,
        from: SocketAddrV4,
        bytes: &[u8],
        out: &mut Outbox,
    ) -> bool {
        let ours = match (self.view.device, self.wanted) {
            (Some(device), _) | (None, Some(device)) => *from.ip() == device,
            (None, None) => true,
        };
        if !ours {
            return false;
        }
        let mut frames = Frames::new(bytes);
        let mut understood = false;
        for frame in frames.by_ref() {
            understood |= self.frame(now_ns, from, &frame, out);
        }
        understood && frames.skipped() == 0
    }

    fn frame(&mut self, now_ns: i64, from: SocketAddrV4, frame: &Frame<'_>, out: &mut Outbox) -> bool {
        let Some(reply) = Reply::read(frame.set, frame.id, frame.payload) else { return false };
        match reply {
            Reply::Broadcast(broadcast) => return self.broadcast(now_ns, from, &broadcast, out),
            Reply::Status(status) => self.status(status),
            Reply::Heartbeat { state, progress_or_status, .. } if self.view.device.is_some() => {
                self.heard_ns = now_ns;
                self.state(state, progress_or_status);
            }
            _ => {}
        }
        let Some((_, _, number)) = self.sent.filter(|_| frame.kind == FrameKind::Ack) else { return true };
        if frame.sequence == number && (frame.set, frame.id) == self.pending_code() {
            self.heard_ns = now_ns;
            self.answered(now_ns, &reply);
        }
        true
    }

    /// A device without a session offers itself.
    fn broadcast(
        &mut self,
        now_ns: i64,
        from: SocketAddrV4,
        broadcast: &Broadcast,
        out: &mut Outbox,
    ) -> bool {
        if self.serial.as_deref().is_some_and(|serial| serial != broadcast.code_text()) {
            return false;
        }
        match self.view.phase {
            Phase::Searching => {}
            // Sent before our handshake came in.
            Phase::Connecting => return true,
            _ => self.lose(Some(Lost::Ended)),
        }
        tracing::info!(code = broadcast.code_text(), kind = broadcast.device_type, address = %from.ip(), "found a LiDAR");
        self.peer = Some(SocketAddrV4::new(*from.ip(), from.port()));
        self.connect(now_ns, out);
        true
    }

    fn connect(&mut self, now_ns: i64, out: &mut Outbox) {
        let Some(peer) = self.peer else { return };
        self.view.device = Some(*peer.ip());
        self.view.phase = Phase::Connecting;
        self.sent = None;
        self.send_pending(now_ns, out);
    }

    fn state(&mut self, state: Result<WorkState, u8>, progress_or_status: u32) {
        self.view.said.state = state.map_or_else(u32::from, |state| state as u32);
        if state != Ok(WorkState::Initialising) {
            self.status(Status(progress_or_status));
        }
        match (self.view.phase, state) {
            (Phase::Starting, Ok(WorkState::Normal)) => {
                self.view.phase = Phase::Configuring;
                self.step = Step::DeviceInfo;
                self.sent = None;
            }
            // A device that falls back is asked to start again when it is ready.
            (
                Phase::Sampling | Phase::Configuring,
                Ok(WorkState::Initialising | WorkState::Error) | Err(_),
            ) => {
                self.view.phase = Phase::Starting;
                self.sent = None;
            }
            _ => {}
        }
        if state == Ok(WorkState::Error) {
            self.view.complaint =
                Some("the device reports an error: look at its window and cable, then switch it off and on");
        }
    }

    fn status(&mut self, status: Status) {
        self.view.said.status = status.0;
        self.view.complaint = status.complaints().next();
    }

    fn pending_code(&self) -> (u8, u8) {
        self.pending().map_or((0, 0), |request| request.code())
    }

    /// The command that the phase waits for.
    fn pending(&self) -> Option<Request<'static>> {
        match self.view.phase {
            Phase::Searching | Phase::Sampling | Phase::Starting => None,
            Phase::Connecting => Some(Request::Handshake {
                host: self.host.address.octets(),
                data_port: self.host.data_port,
                command_port: self.host.command_port,
                imu_port: Some(self.host.data_port),
            }),
            Phase::Configuring => Some(match self.step {
                Step::DeviceInfo => Request::DeviceInfo,
                Step::Extrinsic => Request::ReadExtrinsic,
                Step::Cartesian => Request::Coordinates { spherical: false },
                Step::ReturnMode => {
                    Request::SetReturnMode(self.return_mode.unwrap_or(livox_sdk1::ReturnMode::First))
                }
                Step::Imu => Request::SetImu(self.imu),
                Step::Start => Request::Sampling(true),
            }),
        }
    }

    fn answered(&mut self, now_ns: i64, reply: &Reply<'_>) {
        self.sent = None;
        let refused = matches!(reply, Reply::Done(code) if *code != 0);
        match self.view.phase {
            // A device that still holds a session with somebody else refuses; asked again in a second.
            Phase::Connecting if refused => {
                self.view.refused = Some(("a session", 1));
                self.sent = Some((now_ns, 0, 0));
            }
            Phase::Connecting => {
                self.view.phase = Phase::Starting;
                self.view.refused = None;
                self.view.sessions += 1;
                (self.heartbeat_ns, self.heard_ns) = (0, now_ns);
            }
            Phase::Configuring => {
                if let Reply::DeviceInfo { firmware, .. } = reply {
                    tracing::info!(?firmware, "the LiDAR's firmware");
                }
                if let Reply::Extrinsic { extrinsic, .. } = reply {
                    tracing::info!(
                        ?extrinsic,
                        "where the LiDAR was told that it sits (not used: [rig] says it)"
                    );
                }
                self.next_step(now_ns, refused);
            }
            _ => {}
        }
    }

    fn next_step(&mut self, now_ns: i64, refused: bool) {
        if refused {
            let what = match self.step {
                Step::DeviceInfo | Step::Extrinsic => "a question",
                Step::Cartesian => "Cartesian points",
                Step::ReturnMode => "the return mode",
                Step::Imu if self.imu => "IMU samples",
                // A Mid-40 has no IMU: nothing to complain of.
                Step::Imu => "",
                Step::Start => "to start",
            };
            if !what.is_empty() {
                self.view.refused = Some((what, 1));
            }
        }
        self.step = match self.step {
            Step::DeviceInfo => Step::Extrinsic,
            Step::Extrinsic => Step::Cartesian,
            Step::Cartesian if self.return_mode.is_some() => Step::ReturnMode,
            Step::Cartesian | Step::ReturnMode => Step::Imu,
            Step::Imu => Step::Start,
            Step::Start if refused => {
                self.sent = Some((now_ns, 0, 0));
                Step::Start
            }
            Step::Start => {
                self.view.phase = Phase::Sampling;
                self.started_ns = now_ns;
                Step::Start
            }
        };
    }

    pub(crate) fn tick(&mut self, now_ns: i64, data_ns: i64, out: &mut Outbox) -> i64 {
        match self.view.phase {
            Phase::Searching => {
                // A device that was named needs no broadcast.
                let Some(device) = self.wanted.filter(|_| self.serial.is_none()) else {
                    return now_ns + SECOND;
                };
                self.peer = Some(SocketAddrV4::new(device, DEVICE_PORT));
                self.connect(now_ns, out);
            }
            Phase::Connecting => {
                let (sent_ns, attempts, _) = self.sent.unwrap_or((0, 0, 0));
                if now_ns - sent_ns >= SECOND {
                    if attempts >= 3 && self.wanted.is_none() {
                        self.lose(None);
                        return now_ns + SECOND;
                    }
                    self.send_pending(now_ns, out);
                }
                return self.sent.map_or(now_ns, |(sent_ns, ..)| sent_ns) + SECOND;
            }
            _ => {}
        }
        if now_ns - self.heard_ns > LOST_NS && self.view.phase != Phase::Connecting {
            self.lose(Some(Lost::NoAnswer));
            return now_ns;
        }
        if now_ns - self.heartbeat_ns >= HEARTBEAT_NS && self.view.phase != Phase::Connecting {
            self.heartbeat_ns = now_ns;
            self.send(Request::Heartbeat, out);
        }
        if self.view.phase == Phase::Sampling && now_ns - data_ns.max(self.started_ns) > SILENT_NS {
            self.view.phase = Phase::Configuring;
            self.step = Step::Start;
        }
        if self.view.phase == Phase::Configuring {
            match self.sent {
                Some((sent_ns, attempts, _)) if now_ns - sent_ns >= ANSWER_NS => {
                    if attempts >= ATTEMPTS && self.step != Step::Start {
                        self.sent = None;
                        self.next_step(now_ns, true);
                    }
                    self.send_pending(now_ns, out);
                }
                None => self.send_pending(now_ns, out),
                Some(_) => {}
            }
        }
        (self.heartbeat_ns + HEARTBEAT_NS)
            .min(self.sent.map_or(i64::MAX, |(sent_ns, ..)| sent_ns + ANSWER_NS))
    }

    pub(crate) fn end(&mut self, out: &mut Outbox) {
        if self.view.device.is_some() {
            self.send(Request::Sampling(false), out);
            self.send(Request::Disconnect, out);
        }
    }

    /// Searches again, after a session that has ended or because nobody gives one.
    fn lose(&mut self, why: Option<Lost>) {
        self.view.lose(why);
        (self.peer, self.sent) = (None, None);
    }

    fn send_pending(&mut self, now_ns: i64, out: &mut Outbox) {
        let Some(request) = self.pending() else { return };
        let attempts = self.sent.map_or(0, |(_, attempts, _)| attempts);
        let number = self.send(request, out);
        self.sent = Some((now_ns, attempts + 1, number));
    }

    fn send(&mut self, request: Request<'_>, out: &mut Outbox) -> u16 {
        // The vendor's software counts 1 to 65,535 too.
        self.sequence = self.sequence.checked_add(1).unwrap_or(1);
        if let Some(peer) = self.peer {
            out.payload.clear();
            request.write(&mut out.payload);
            let (set, id) = request.code();
            let payload = &out.payload;
            Frame { kind: FrameKind::Command, sequence: self.sequence, set, id, payload }
                .encode(&mut out.frame);
            out.push(Channel::Command, peer);
        }
        self.sequence
    }
}
