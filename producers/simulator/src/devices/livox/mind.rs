//! A device's mind, without sockets and clocks: datagrams and times in, datagrams out.

use std::net::SocketAddrV4;

use super::config::{LivoxConfig, LivoxProtocol};
use super::sdk1::Sdk1;
use super::sdk2::Sdk2;

/// What a device does about what it hears, and when.
#[derive(Debug)]
pub struct LivoxMind(Protocol);

#[derive(Debug)]
enum Protocol {
    Sdk1(Sdk1),
    Sdk2(Sdk2),
}

impl LivoxMind {
    /// A device that is powered on at `now_ns`.
    pub fn new(config: &LivoxConfig, now_ns: i64) -> Self {
        Self(match config.protocol {
            LivoxProtocol::Sdk1 => Protocol::Sdk1(Sdk1::new(config, now_ns)),
            LivoxProtocol::Sdk2 => Protocol::Sdk2(Sdk2::new(config, now_ns)),
        })
    }

    /// Handles a datagram; answers leave by the socket that it came to.
    pub fn receive(
        &mut self,
        now_ns: i64,
        from: SocketAddrV4,
        bytes: &[u8],
        answer: impl FnMut(SocketAddrV4, &[u8]),
    ) {
        match &mut self.0 {
            Protocol::Sdk1(mind) => mind.receive(now_ns, from, bytes, answer),
            Protocol::Sdk2(mind) => mind.receive(now_ns, from, bytes, answer),
        }
    }

    /// Says what is due, by the socket for commands.
    pub fn tick(&mut self, now_ns: i64, say: impl FnMut(SocketAddrV4, &[u8])) {
        match &mut self.0 {
            Protocol::Sdk1(mind) => mind.tick(now_ns, say),
            Protocol::Sdk2(mind) => mind.tick(now_ns, say),
        }
    }

    /// Power off, and on again at `now_ns`.
    pub fn power_cycle(&mut self, now_ns: i64) {
        match &mut self.0 {
            Protocol::Sdk1(mind) => mind.power_cycle(now_ns),
            Protocol::Sdk2(mind) => mind.power_cycle(now_ns),
        }
    }

    /// Where points go, while it measures.
    pub fn target(&self, now_ns: i64) -> Option<SocketAddrV4> {
        match &self.0 {
            Protocol::Sdk1(mind) => mind.target(),
            Protocol::Sdk2(mind) => mind.target(now_ns),
        }
    }

    /// Where samples of its own IMU go, while it sends some.
    pub(super) fn imu_target(&self, now_ns: i64) -> Option<SocketAddrV4> {
        match &self.0 {
            Protocol::Sdk1(mind) => mind.imu_target(),
            Protocol::Sdk2(mind) => mind.imu_target(now_ns),
        }
    }

    /// What it says of itself from now on: status word, or diagnostics.
    pub(super) fn set_status(&mut self, status: u32) {
        match &mut self.0 {
            Protocol::Sdk1(mind) => mind.status = status,
            Protocol::Sdk2(mind) => mind.diagnostics = status as u16,
        }
    }
}
