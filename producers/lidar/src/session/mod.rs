//! The conversation with a device, without sockets and clocks: datagrams and times in, datagrams and changes out.

mod outbox;
#[cfg(test)]
mod recovery;
mod sdk1;
mod sdk2;

use std::net::{Ipv4Addr, SocketAddrV4};

use evac_frames::{NO_DEVICE_STATE, NO_TEMPERATURE};

pub(crate) use outbox::{Channel, Outbox};

use crate::{Config, Protocol};
use sdk1::Sdk1;
use sdk2::Sdk2;

/// Nanoseconds of a second.
pub(crate) const SECOND: i64 = 1_000_000_000;
/// A device that answers nothing for this long is gone.
pub(crate) const LOST_NS: i64 = 3 * SECOND;
/// A device that answers and should send, but sends nothing for this long, is told again.
pub(crate) const SILENT_NS: i64 = 2 * SECOND;

/// That a device has gone is known within this time: the longest pause between two looks comes on top of [`LOST_NS`].
#[cfg(test)]
const NOTICED_NS: i64 = LOST_NS + SECOND;
/// A device that is there, ready and free measures for us within this time: a retry, and a heartbeat or question. docs/devices.md
/// states both.
#[cfg(test)]
const RECOVERED_NS: i64 = 2 * SECOND;

/// Where this computer is reached.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Host {
    pub(crate) address: Ipv4Addr,
    pub(crate) command_port: u16,
    pub(crate) data_port: u16,
}

/// How far the conversation is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Nobody has answered yet.
    Searching,
    /// A device is asked for a session.
    Connecting,
    /// It answers and is not ready to measure.
    Starting,
    /// It is told how to measure.
    Configuring,
    /// It measures.
    Sampling,
}

/// Why a session has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lost {
    /// No answer to heartbeats or questions.
    NoAnswer,
    /// The device offers itself again: it was restarted, or has missed our heartbeats.
    Ended,
}

impl Lost {
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::NoAnswer => "no answer for 3 s",
            Self::Ended => "ended by the device",
        }
    }
}

/// What a session has found out; changes are seen by comparing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct View {
    pub(crate) phase: Phase,
    /// The device of this session.
    pub(crate) device: Option<Ipv4Addr>,
    /// Sessions begun.
    pub(crate) sessions: u64,
    /// Why the last one has ended.
    pub(crate) lost: Option<Lost>,
    /// What the device complains of.
    pub(crate) complaint: Option<&'static str>,
    /// The last command that the device has refused, and its code.
    pub(crate) refused: Option<(&'static str, u8)>,
    /// What it says of itself.
    pub(crate) said: Said,
}

/// What a device says of itself, as it stands on the wire; see [`evac_frames::DeviceHealth`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Said {
    pub(crate) state: u32,
    pub(crate) status: u32,
    pub(crate) temperature_centi: i32,
    pub(crate) codes: [u32; 8],
}

impl Said {
    fn nothing() -> Self {
        Self { state: NO_DEVICE_STATE, status: 0, temperature_centi: NO_TEMPERATURE, codes: [0; 8] }
    }
}

impl View {
    fn new() -> Self {
        Self {
            phase: Phase::Searching,
            device: None,
            sessions: 0,
            lost: None,
            complaint: None,
            refused: None,
            said: Said::nothing(),
        }
    }

    /// The session has ended; whoever was it, nobody is there now.
    fn lose(&mut self, why: Option<Lost>) {
        *self =
            Self { sessions: self.sessions, lost: why.or(self.lost), refused: self.refused, ..Self::new() };
    }
}

/// A conversation by either protocol.
#[derive(Debug)]
pub(crate) enum Session {
    Sdk1(Sdk1),
    Sdk2(Sdk2),
}

impl Session {
    pub(crate) fn new(config: &Config, host: Host) -> Self {
        match config.protocol {
            Protocol::Sdk1 => Self::Sdk1(Sdk1::new(config, host)),
            Protocol::Sdk2 => Self::Sdk2(Sdk2::new(config, host)),
        }
    }

    pub(crate) fn view(&self) -> View {
        match self {
            Self::Sdk1(session) => session.view,
            Self::Sdk2(session) => session.view,
        }
    }

    /// Handles a control datagram; whether it was of the device and whole.
    pub(crate) fn receive(
        &mut self,
        now_ns: i64,
        from: SocketAddrV4,
        bytes: &[u8],
        out: &mut Outbox,
    ) -> bool {
        match self {
            Self::Sdk1(session) => session.receive(now_ns, from, bytes, out),
            Self::Sdk2(session) => session.receive(now_ns, from, bytes, out),
        }
    }

    /// Says what is due; gives the time at which something will be next. `data_ns` is when the last data packet came.
    pub(crate) fn tick(&mut self, now_ns: i64, data_ns: i64, out: &mut Outbox) -> i64 {
        match self {
            Self::Sdk1(session) => session.tick(now_ns, data_ns, out),
            Self::Sdk2(session) => session.tick(now_ns, data_ns, out),
        }
    }

    /// Says good-bye, so that the device stops and is free for the next host.
    pub(crate) fn end(&mut self, out: &mut Outbox) {
        match self {
            Self::Sdk1(session) => session.end(out),
            Self::Sdk2(session) => session.end(out),
        }
    }
}

#[cfg(test)]
mod tests {
    use evac_formats::{livox_sdk1, livox_sdk2};
    use proptest::prelude::*;

    use super::*;

    const DEVICE: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(127, 0, 0, 2), 65000);

    fn session(protocol: Protocol) -> Session {
        let config = Config { protocol, device: Some(*DEVICE.ip()), ..Config::default() };
        Session::new(&config, Host { address: Ipv4Addr::LOCALHOST, command_port: 1, data_port: 2 })
    }

    /// Frames with right checksums around any payload: what gets past them must not harm.
    fn framed(protocol: Protocol, set: u8, id: u8, answer: bool, payload: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        match protocol {
            Protocol::Sdk1 => {
                let kind = if answer { livox_sdk1::FrameKind::Ack } else { livox_sdk1::FrameKind::Message };
                livox_sdk1::Frame { kind, sequence: 1, set: set % 2, id: id % 13, payload }.encode(&mut out);
            }
            Protocol::Sdk2 => {
                let kind = if answer { livox_sdk2::FrameKind::Ack } else { livox_sdk2::FrameKind::Request };
                let command = u16::from(set % 2) << 8 | u16::from(id % 3);
                livox_sdk2::Frame {
                    sequence: 1,
                    command,
                    kind,
                    sender: livox_sdk2::Sender::Lidar,
                    data: payload,
                }
                .encode(&mut out);
            }
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn no_datagrams_in_any_order_harm_a_session(
            second in any::<bool>(),
            said in proptest::collection::vec((any::<u8>(), any::<u8>(), any::<bool>(), proptest::collection::vec(any::<u8>(), 0..40), 0..2 * SECOND), 0..60),
        ) {
            let protocol = if second { Protocol::Sdk2 } else { Protocol::Sdk1 };
            let (mut session, mut out, mut now, mut sent) = (session(protocol), Outbox::default(), 0, 0);
            for (set, id, answer, payload, later) in said {
                now += later;
                session.receive(now, DEVICE, &framed(protocol, set, id, answer, &payload), &mut out);
                session.receive(now, DEVICE, &payload, &mut out);
                prop_assert!(session.tick(now, 0, &mut out) >= now.min(0));
                // A device cannot make a host flood it.
                let before = sent;
                out.drain(|_, _, _| sent += 1);
                prop_assert!(sent - before <= 6);
            }
            session.end(&mut out);
        }
    }

    #[test]
    fn an_address_that_is_not_the_device_s_is_not_listened_to() {
        for protocol in [Protocol::Sdk1, Protocol::Sdk2] {
            let (mut session, mut out) = (session(protocol), Outbox::default());
            let other = SocketAddrV4::new(Ipv4Addr::new(127, 0, 0, 3), 65000);
            let before = session.view();
            let reply = framed(protocol, 0, 0, true, &[0; 24]);
            assert!(!session.receive(0, other, &reply, &mut out));
            assert_eq!(session.view(), before);
        }
    }
}
