//! The mind of a device of the second protocol: datagrams and times in, datagrams out.

use std::net::SocketAddrV4;

use evac_formats::livox_sdk2::{
    DataType, Frame, FrameKind, HostAddress, Parameters, ParametersWriter, SearchReply, Sender, TimeType,
    WorkState, WriteReply, command, key, ports, return_code,
};

use super::config::{LivoxConfig, TimeSource};

/// A Mid-360.
const DEVICE_TYPE: u8 = 9;
/// Time between two pushed reports, nanoseconds.
const PUSH_NS: i64 = 1_000_000_000;

/// The device.
#[derive(Debug)]
pub(super) struct Sdk2 {
    serial: [u8; 16],
    command: SocketAddrV4,
    time_type: TimeType,
    boot_ns: i64,
    powered_ns: i64,
    pushed_ns: i64,
    sequence: u32,
    target: WorkState,
    state_host: Option<HostAddress>,
    point_host: Option<HostAddress>,
    imu_host: Option<HostAddress>,
    has_imu: bool,
    sends_imu: bool,
    /// What it says of itself.
    pub(super) diagnostics: u16,
    data: Vec<u8>,
    frame: Vec<u8>,
}

impl Sdk2 {
    pub(super) fn new(config: &LivoxConfig, now_ns: i64) -> Self {
        Self {
            serial: config.code(),
            command: SocketAddrV4::new(config.address, ports::COMMAND),
            time_type: time_type(config.time_source),
            boot_ns: (config.boot_s * 1e9) as i64,
            powered_ns: now_ns,
            pushed_ns: now_ns,
            sequence: 0,
            target: WorkState::Idle,
            state_host: None,
            point_host: None,
            imu_host: None,
            has_imu: config.imu,
            sends_imu: false,
            diagnostics: 0,
            data: Vec::new(),
            frame: Vec::new(),
        }
    }

    fn state(&self, now_ns: i64) -> WorkState {
        if now_ns - self.powered_ns < self.boot_ns { WorkState::SelfCheck } else { self.target }
    }

    /// Where points go, while it measures.
    pub(super) fn target(&self, now_ns: i64) -> Option<SocketAddrV4> {
        (self.state(now_ns) == WorkState::Sampling).then_some(self.point_host?.host)
    }

    /// Where IMU samples go, while it sends some.
    pub(super) fn imu_target(&self, now_ns: i64) -> Option<SocketAddrV4> {
        (self.sends_imu && self.state(now_ns) == WorkState::Sampling).then_some(self.imu_host?.host)
    }

    /// Power off and on.
    pub(super) fn power_cycle(&mut self, now_ns: i64) {
        (self.target, self.powered_ns) = (WorkState::Idle, now_ns);
        (self.state_host, self.point_host, self.imu_host) = (None, None, None);
        self.sends_imu = false;
    }

    pub(super) fn tick(&mut self, now_ns: i64, mut send: impl FnMut(SocketAddrV4, &[u8])) {
        let Some(host) = self.state_host.filter(|_| now_ns - self.pushed_ns >= PUSH_NS) else { return };
        self.pushed_ns = now_ns;
        let mut data = std::mem::take(&mut self.data);
        let mut list = ParametersWriter::request(&mut data);
        for wanted in [key::SERIAL, key::WORK_STATE, key::TIME_TYPE, key::DIAGNOSTICS] {
            self.put(&mut list, wanted, now_ns);
        }
        self.data = data;
        self.sequence = self.sequence.wrapping_add(1);
        self.say(self.sequence, command::PUSH, FrameKind::Request);
        send(host.host, &self.frame);
    }

    pub(super) fn receive(
        &mut self,
        now_ns: i64,
        from: SocketAddrV4,
        bytes: &[u8],
        mut send: impl FnMut(SocketAddrV4, &[u8]),
    ) {
        let Ok(request) = Frame::parse(bytes) else { return };
        if (request.kind, request.sender) != (FrameKind::Request, Sender::Host) {
            return;
        }
        let mut data = std::mem::take(&mut self.data);
        data.clear();
        match request.command {
            command::SEARCH => SearchReply {
                return_code: return_code::OK,
                device_type: DEVICE_TYPE,
                serial: self.serial,
                command: self.command,
            }
            .encode(&mut data),
            command::WRITE_PARAMETERS => data.extend(self.write(request.data).to_bytes()),
            command::READ_PARAMETERS => {
                let mut list = ParametersWriter::answer(return_code::OK, &mut data);
                for wanted in Parameters::keys_of_query(request.data) {
                    self.put(&mut list, wanted, now_ns);
                }
            }
            command::REBOOT => {
                data.push(return_code::OK);
                self.power_cycle(now_ns);
            }
            _ => data.push(return_code::FAILED),
        }
        self.data = data;
        self.say(request.sequence, request.command, FrameKind::Ack);
        send(from, &self.frame);
    }

    fn write(&mut self, data: &[u8]) -> WriteReply {
        let refused = |return_code, key| WriteReply { return_code, key };
        let Some(list) = Parameters::of_request(data).filter(Parameters::is_whole) else {
            return refused(return_code::BAD_LENGTH, 0);
        };
        for parameter in list {
            let (key, value) = (parameter.key, parameter.value);
            let done = match key {
                key::STATE_HOST => HostAddress::parse(value).map(|host| self.state_host = Some(host)),
                key::POINT_HOST => HostAddress::parse(value).map(|host| self.point_host = Some(host)),
                key::IMU_HOST => HostAddress::parse(value).map(|host| self.imu_host = Some(host)),
                key::POINT_DATA_TYPE => match parameter.byte() {
                    Some(value) if value == DataType::Cartesian32 as u8 => Some(()),
                    Some(_) => return refused(return_code::OUT_OF_RANGE, key),
                    None => None,
                },
                key::WORK_TARGET => match parameter.byte().and_then(WorkState::from_wire) {
                    Some(target @ (WorkState::Sampling | WorkState::Idle)) => {
                        self.target = target;
                        Some(())
                    }
                    _ => return refused(return_code::OUT_OF_RANGE, key),
                },
                key::IMU_ENABLED if !self.has_imu => return refused(return_code::UNKNOWN_KEY, key),
                key::IMU_ENABLED => parameter.byte().map(|on| self.sends_imu = on == 1),
                _ => return refused(return_code::UNKNOWN_KEY, key),
            };
            if done.is_none() {
                return refused(return_code::BAD_LENGTH, key);
            }
        }
        refused(return_code::OK, 0)
    }

    fn put(&self, list: &mut ParametersWriter<'_>, wanted: u16, now_ns: i64) {
        match wanted {
            key::SERIAL => list.put(wanted, &self.serial),
            key::WORK_STATE => list.put(wanted, &[self.state(now_ns) as u8]),
            key::TIME_TYPE => list.put(wanted, &[self.time_type as u8]),
            key::DIAGNOSTICS => list.put(wanted, &self.diagnostics.to_le_bytes()),
            // 41.5 degrees Celsius.
            key::CORE_TEMPERATURE => list.put(wanted, &4150_i32.to_le_bytes()),
            key::HEALTH_CODES => list.put(wanted, &[0; 32]),
            key::FIRMWARE_TYPE => list.put(wanted, &[1]),
            _ => {}
        }
    }

    fn say(&mut self, sequence: u32, command: u16, kind: FrameKind) {
        Frame { sequence, command, kind, sender: Sender::Lidar, data: &self.data }.encode(&mut self.frame);
    }
}

/// As data packets say it.
pub(super) fn time_type(source: TimeSource) -> TimeType {
    match source {
        TimeSource::Ptp => TimeType::Ptp,
        TimeSource::Gps => TimeType::Gps,
        TimeSource::PowerOn | TimeSource::Pulse => TimeType::PowerOn,
    }
}
