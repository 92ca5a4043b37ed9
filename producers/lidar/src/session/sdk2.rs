//! The second protocol: search, parameters, and questions in place of a heartbeat.

use std::net::{Ipv4Addr, SocketAddrV4};

use evac_formats::livox_sdk2::{
    DataType, Diagnostics, Frame, FrameKind, HostAddress, Parameters, ParametersWriter, SearchReply, Sender,
    WorkState, WriteReply, command, key, ports, return_code,
};

use super::{Channel, Host, LOST_NS, Lost, Outbox, Phase, SECOND, SILENT_NS, View};
use crate::Config;

/// What a device is told before it measures, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Where to send; not each device has the first of these keys.
    Hosts {
        with_state: bool,
    },
    Cartesian,
    Imu,
    Start,
}

/// The conversation.
#[derive(Debug)]
pub(crate) struct Sdk2 {
    pub(super) view: View,
    host: Host,
    wanted: Option<Ipv4Addr>,
    serial: Option<String>,
    /// Whether samples of the device's own IMU are wanted.
    imu: bool,
    /// Where commands go.
    peer: Option<SocketAddrV4>,
    device_type: u8,
    sequence: u32,
    /// The command under way: when it was sent, and its number.
    sent: Option<(i64, u32)>,
    step: Step,
    search_ns: i64,
    question_ns: i64,
    heard_ns: i64,
    started_ns: i64,
}

impl Sdk2 {
    pub(crate) fn new(config: &Config, host: Host) -> Self {
        Self {
            view: View::new(),
            host,
            wanted: config.device,
            serial: config.serial.clone(),
            imu: config.publish_imu,
            peer: None,
            device_type: 0,
            sequence: 0,
            sent: None,
            step: Step::Hosts { with_state: true },
            search_ns: i64::MIN / 2,
            question_ns: 0,
            heard_ns: 0,
            started_ns: 0,
        }
    }

    pub(crate) fn receive(
        &mut self,
        now_ns: i64,
        from: SocketAddrV4,
        bytes: &[u8],
        _out: &mut Outbox,
    ) -> bool {
        let ours = match (self.view.device, self.wanted) {
            (Some(device), _) | (None, Some(device)) => *from.ip() == device,
            (None, None) => true,
        };
        let Some(frame) = Frame::parse(bytes).ok().filter(|frame| ours && frame.sender == Sender::Lidar)
        else {
            return false;
        };
        match (frame.command, frame.kind) {
            (command::SEARCH, FrameKind::Ack) => return self.found(now_ns, from, frame.data),
            (command::PUSH, FrameKind::Request) => {
                if let Some(list) = Parameters::of_request(frame.data) {
                    self.told(now_ns, &list);
                }
            }
            (command::READ_PARAMETERS, FrameKind::Ack) => {
                if let Some((return_code::OK, list)) = Parameters::of_answer(frame.data) {
                    self.told(now_ns, &list);
                }
            }
            (command::WRITE_PARAMETERS, FrameKind::Ack) => {
                self.heard_ns = now_ns;
                if let (Some((_, number)), Some(reply)) = (self.sent, WriteReply::parse(frame.data))
                    && number == frame.sequence
                {
                    self.answered(now_ns, reply);
                }
            }
            _ => {}
        }
        true
    }

    fn found(&mut self, now_ns: i64, from: SocketAddrV4, data: &[u8]) -> bool {
        let Some(reply) = SearchReply::parse(data).filter(|reply| reply.return_code == return_code::OK)
        else {
            return false;
        };
        let end = reply.serial.iter().position(|byte| *byte == 0).unwrap_or(reply.serial.len());
        let serial = String::from_utf8_lossy(reply.serial.get(..end).unwrap_or_default());
        if self.serial.as_deref().is_some_and(|wanted| wanted != serial) {
            return false;
        }
        if self.view.phase == Phase::Searching {
            tracing::info!(%serial, kind = reply.device_type, address = %from.ip(), "found a LiDAR");
            // The address that it was heard from: the one it says may lie behind a bridge.
            self.peer = Some(SocketAddrV4::new(*from.ip(), reply.command.port()));
            self.device_type = reply.device_type;
            self.view.device = Some(*from.ip());
            self.view.sessions += 1;
            self.heard_ns = now_ns;
            self.configure();
        }
        true
    }

    fn configure(&mut self) {
        self.view.phase = Phase::Configuring;
        self.step = Step::Hosts { with_state: true };
        self.sent = None;
    }

    /// The device says something about itself.
    fn told(&mut self, now_ns: i64, list: &Parameters<'_>) {
        self.heard_ns = now_ns;
        let byte = |key| list.get(key).and_then(|parameter| parameter.byte());
        let said = &mut self.view.said;
        let diagnostics = list.get(key::DIAGNOSTICS).and_then(|parameter| parameter.value.try_into().ok());
        if let Some(diagnostics) = diagnostics.map(u16::from_le_bytes) {
            said.status = u32::from(diagnostics);
            self.view.complaint = Diagnostics(diagnostics).complaint();
        }
        let temperature =
            list.get(key::CORE_TEMPERATURE).and_then(|parameter| parameter.value.try_into().ok());
        said.temperature_centi = temperature.map_or(said.temperature_centi, i32::from_le_bytes);
        if let Some(codes) = list.get(key::HEALTH_CODES) {
            for (code, bytes) in said.codes.iter_mut().zip(codes.value.as_chunks::<4>().0) {
                *code = u32::from_le_bytes(*bytes);
            }
        }
        let Some(state) = byte(key::WORK_STATE) else { return };
        said.state = u32::from(state);
        let Some(state) = WorkState::from_wire(state) else { return };
        if state == WorkState::Error {
            self.view.complaint =
                Some("the device reports an error: look at its window and cable, then switch it off and on");
        }
        match (self.view.phase, state) {
            (Phase::Starting, WorkState::Sampling) => self.sampling(now_ns),
            // It was switched off and on between two questions, or another host has told it something else.
            (Phase::Sampling, state) if state != WorkState::Sampling && state != WorkState::Error => {
                self.lose(Lost::Ended);
            }
            _ => {}
        }
    }

    fn sampling(&mut self, now_ns: i64) {
        self.view.phase = Phase::Sampling;
        self.started_ns = now_ns;
    }

    fn answered(&mut self, now_ns: i64, reply: WriteReply) {
        self.sent = None;
        let refused = reply.return_code != return_code::OK;
        self.step = match (self.step, refused) {
            (Step::Hosts { with_state: true }, true) => Step::Hosts { with_state: false },
            (Step::Hosts { .. }, true) => {
                self.refused("where to send", reply.return_code, now_ns);
                self.step
            }
            (Step::Hosts { .. }, false) => Step::Cartesian,
            (Step::Cartesian, true) => {
                self.refused("Cartesian points", reply.return_code, now_ns);
                Step::Imu
            }
            (Step::Cartesian, false) => Step::Imu,
            (Step::Imu, true) if self.imu => {
                self.refused("IMU samples", reply.return_code, now_ns);
                Step::Start
            }
            // Not each device has an IMU.
            (Step::Imu, _) => Step::Start,
            (Step::Start, true) => {
                self.refused("to start", reply.return_code, now_ns);
                Step::Start
            }
            (Step::Start, false) => {
                self.view.refused = None;
                self.view.phase = Phase::Starting;
                Step::Start
            }
        };
    }

    /// Asked again in a second.
    fn refused(&mut self, what: &'static str, code: u8, now_ns: i64) {
        self.view.refused = Some((what, code));
        self.sent = Some((now_ns, 0));
    }

    pub(crate) fn tick(&mut self, now_ns: i64, data_ns: i64, out: &mut Outbox) -> i64 {
        if self.view.phase == Phase::Searching {
            if now_ns - self.search_ns >= SECOND {
                self.search_ns = now_ns;
                out.payload.clear();
                let to = self.wanted.unwrap_or(Ipv4Addr::BROADCAST);
                self.send(command::SEARCH, Channel::Search, SocketAddrV4::new(to, ports::SEARCH), out);
            }
            return self.search_ns + SECOND;
        }
        // Data alone does not keep a session: it may be an old one's.
        if now_ns - self.heard_ns > LOST_NS {
            self.lose(Lost::NoAnswer);
            return now_ns;
        }
        if self.view.phase == Phase::Starting
            && data_ns > self.heard_ns - SECOND
            && now_ns - data_ns < SECOND / 2
        {
            self.sampling(now_ns);
        }
        if self.view.phase == Phase::Sampling && now_ns - data_ns.max(self.started_ns) > SILENT_NS {
            // It may have forgotten where to send.
            self.configure();
        }
        if self.view.phase == Phase::Configuring
            && self.sent.is_none_or(|(sent_ns, _)| now_ns - sent_ns >= SECOND)
        {
            self.send_step(now_ns, out);
        }
        if now_ns - self.question_ns >= SECOND
            && let Some(peer) = self.peer
        {
            self.question_ns = now_ns;
            ParametersWriter::query(&[key::WORK_STATE, key::DIAGNOSTICS], &mut out.payload);
            self.send(command::READ_PARAMETERS, Channel::Command, peer, out);
            // Apart: a device that does not know one key refuses them all.
            ParametersWriter::query(&[key::CORE_TEMPERATURE, key::HEALTH_CODES], &mut out.payload);
            self.send(command::READ_PARAMETERS, Channel::Command, peer, out);
        }
        let answer_ns = self.sent.map_or(i64::MAX, |(sent_ns, _)| sent_ns + SECOND);
        answer_ns.min(self.question_ns + SECOND)
    }

    fn send_step(&mut self, now_ns: i64, out: &mut Outbox) {
        let Some(peer) = self.peer else { return };
        let mut list = ParametersWriter::request(&mut out.payload);
        match self.step {
            Step::Hosts { with_state } => {
                // A HAP uses other ports than a Mid-360 and has no key for the first.
                let hap = matches!(self.device_type, 10 | 15);
                let to = |port, device_port| {
                    HostAddress { host: SocketAddrV4::new(self.host.address, port), device_port }.to_bytes()
                };
                if with_state && !hap {
                    list.put(key::STATE_HOST, &to(self.host.command_port, ports::PUSH));
                }
                let (points, imu) = if hap { (57000, 58000) } else { (ports::POINTS, ports::IMU) };
                list.put(key::POINT_HOST, &to(self.host.data_port, points));
                list.put(key::IMU_HOST, &to(self.host.data_port, imu));
            }
            Step::Cartesian => list.put(key::POINT_DATA_TYPE, &[DataType::Cartesian32 as u8]),
            Step::Imu => list.put(key::IMU_ENABLED, &[u8::from(self.imu)]),
            Step::Start => list.put(key::WORK_TARGET, &[WorkState::Sampling as u8]),
        }
        let number = self.send(command::WRITE_PARAMETERS, Channel::Command, peer, out);
        self.sent = Some((now_ns, number));
    }

    pub(crate) fn end(&mut self, out: &mut Outbox) {
        if let Some(peer) = self.peer {
            ParametersWriter::request(&mut out.payload).put(key::WORK_TARGET, &[WorkState::Idle as u8]);
            self.send(command::WRITE_PARAMETERS, Channel::Command, peer, out);
        }
    }

    fn lose(&mut self, why: Lost) {
        self.view.lose(Some(why));
        (self.peer, self.sent) = (None, None);
        self.search_ns = i64::MIN / 2;
    }

    /// Sends what lies in the outbox's payload.
    fn send(&mut self, command: u16, channel: Channel, to: SocketAddrV4, out: &mut Outbox) -> u32 {
        // The vendor's software counts 16 bits and leaves 0 out.
        self.sequence = self.sequence % 65_535 + 1;
        let frame = Frame {
            sequence: self.sequence,
            command,
            kind: FrameKind::Request,
            sender: Sender::Host,
            data: &out.payload,
        };
        frame.encode(&mut out.frame);
        out.push(channel, to);
        self.sequence
    }
}
