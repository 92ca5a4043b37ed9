//! The mind of a device of the first protocol: datagrams and times in, datagrams out.

use std::net::{Ipv4Addr, SocketAddrV4};

use evac_formats::livox_sdk1::{
    Broadcast, Extrinsic, Frame, FrameKind, Frames, Network, Reply, Request, ReturnMode, WorkState,
};

use super::config::LivoxConfig;

/// Broadcasts go to this port.
const BROADCAST_PORT: u16 = 55000;
/// Time between two broadcasts, nanoseconds.
const BROADCAST_NS: i64 = 1_000_000_000;
/// By whether it has an IMU: Mid-40, Avia.
const DEVICE_TYPES: [u8; 2] = [1, 7];

/// A session with a host.
#[derive(Debug, Clone, Copy)]
struct Host {
    command: SocketAddrV4,
    data: SocketAddrV4,
    imu: SocketAddrV4,
    heartbeat_ns: i64,
}

/// The device.
#[derive(Debug)]
pub(super) struct Sdk1 {
    code: [u8; 16],
    address: Ipv4Addr,
    broadcast_to: SocketAddrV4,
    session_ns: i64,
    boot_ns: i64,
    powered_ns: i64,
    broadcast_ns: i64,
    host: Option<Host>,
    is_sampling: bool,
    has_imu: bool,
    sends_imu: bool,
    /// What it says of itself.
    pub(super) status: u32,
    extrinsic: Extrinsic,
    payload: Vec<u8>,
    frame: Vec<u8>,
}

impl Sdk1 {
    pub(super) fn new(config: &LivoxConfig, now_ns: i64) -> Self {
        Self {
            code: config.code(),
            address: config.address,
            broadcast_to: SocketAddrV4::new(config.broadcast_to, BROADCAST_PORT),
            session_ns: (config.session_s * 1e9) as i64,
            boot_ns: (config.boot_s * 1e9) as i64,
            powered_ns: now_ns,
            broadcast_ns: i64::MIN / 2,
            host: None,
            is_sampling: false,
            has_imu: config.imu,
            sends_imu: false,
            status: 0,
            extrinsic: Extrinsic { roll_pitch_yaw_deg: [0.0; 3], translation_mm: [0; 3] },
            payload: Vec::new(),
            frame: Vec::new(),
        }
    }

    /// Where points go, while it measures.
    pub(super) fn target(&self) -> Option<SocketAddrV4> {
        self.host.filter(|_| self.is_sampling).map(|host| host.data)
    }

    /// Where IMU samples go, while it sends some.
    pub(super) fn imu_target(&self) -> Option<SocketAddrV4> {
        self.host.filter(|_| self.is_sampling && self.sends_imu).map(|host| host.imu)
    }

    /// Power off and on.
    pub(super) fn power_cycle(&mut self, now_ns: i64) {
        (self.host, self.is_sampling, self.powered_ns) = (None, false, now_ns);
        self.sends_imu = false;
    }

    pub(super) fn tick(&mut self, now_ns: i64, mut send: impl FnMut(SocketAddrV4, &[u8])) {
        if self.host.is_some_and(|host| now_ns - host.heartbeat_ns > self.session_ns) {
            (self.host, self.is_sampling) = (None, false);
        }
        if self.host.is_none() && now_ns - self.broadcast_ns >= BROADCAST_NS {
            self.broadcast_ns = now_ns;
            let broadcast = Broadcast {
                code: self.code,
                device_type: DEVICE_TYPES[usize::from(self.has_imu)],
                reserved: 0,
            };
            self.say(FrameKind::Message, 0, (0, 0), &Reply::Broadcast(broadcast));
            send(self.broadcast_to, &self.frame);
        }
    }

    pub(super) fn receive(
        &mut self,
        now_ns: i64,
        from: SocketAddrV4,
        bytes: &[u8],
        mut send: impl FnMut(SocketAddrV4, &[u8]),
    ) {
        for frame in Frames::new(bytes) {
            let Some(request) = Request::read(frame.set, frame.id, frame.payload) else { continue };
            if let Some(reply) = self.answer(now_ns, from, &request) {
                self.say(FrameKind::Ack, frame.sequence, (frame.set, frame.id), &reply);
                send(from, &self.frame);
            }
        }
    }

    fn answer(&mut self, now_ns: i64, from: SocketAddrV4, request: &Request<'_>) -> Option<Reply<'static>> {
        const DONE: Reply<'static> = Reply::Done(0);
        const REFUSED: Reply<'static> = Reply::Done(1);
        if let Request::Handshake { host, data_port, imu_port, .. } = *request {
            // A device that has a session does not take another: it is silent until the old one has timed out.
            if self.host.is_some_and(|host| host.command != from) {
                return None;
            }
            let [data, imu] = [data_port, imu_port.unwrap_or(data_port)]
                .map(|port| SocketAddrV4::new(Ipv4Addr::from(host), port));
            self.host = Some(Host { command: from, data, imu, heartbeat_ns: now_ns });
            return Some(DONE);
        }
        let host = self.host.as_mut().filter(|host| host.command == from)?;
        Some(match *request {
            Request::Heartbeat => {
                host.heartbeat_ns = now_ns;
                let booting = now_ns - self.powered_ns < self.boot_ns;
                let progress = ((now_ns - self.powered_ns) * 100 / self.boot_ns.max(1)) as u32;
                Reply::Heartbeat {
                    code: 0,
                    state: Ok(if booting { WorkState::Initialising } else { WorkState::Normal }),
                    features: 0,
                    progress_or_status: if booting { progress } else { self.status },
                }
            }
            Request::DeviceInfo => Reply::DeviceInfo { code: 0, firmware: [3, 8, 0, 0] },
            Request::Sampling(on) => {
                self.is_sampling = on;
                DONE
            }
            Request::Disconnect => {
                (self.host, self.is_sampling) = (None, false);
                DONE
            }
            Request::WriteExtrinsic(extrinsic) => {
                self.extrinsic = extrinsic;
                DONE
            }
            Request::ReadExtrinsic => Reply::Extrinsic { code: 0, extrinsic: self.extrinsic },
            Request::GetNetwork => Reply::Network {
                code: 0,
                network: Network { mode: 1, address: self.address.octets(), mask_and_gateway: None },
            },
            Request::Reboot(_) => {
                self.power_cycle(now_ns);
                DONE
            }
            Request::SetMode(1)
            | Request::RainFog(_)
            | Request::UtcTime(_)
            | Request::Coordinates { spherical: false } => DONE,
            Request::SetReturnMode(ReturnMode::First) => DONE,
            Request::SetImu(on) if self.has_imu => {
                self.sends_imu = on;
                DONE
            }
            // A Mid-40 has neither IMU nor fan nor echoes, and this one no other coordinates.
            _ => REFUSED,
        })
    }

    fn say(&mut self, kind: FrameKind, sequence: u16, (set, id): (u8, u8), reply: &Reply<'_>) {
        self.payload.clear();
        reply.write(&mut self.payload);
        Frame { kind, sequence, set, id, payload: &self.payload }.encode(&mut self.frame);
    }
}
