//! How soon a session is there again: the real session and a simulated device talk, in a time that the test counts.

use std::net::{Ipv4Addr, SocketAddrV4};

use evac_simulator::devices::livox::{LivoxConfig, LivoxMind, LivoxProtocol};

use super::{Host, NOTICED_NS, Outbox, Phase, RECOVERED_NS, SECOND, Session};
use crate::{Config, Protocol};

const HOST: Ipv4Addr = Ipv4Addr::new(192, 168, 1, 50);
const DEVICE: Ipv4Addr = Ipv4Addr::new(192, 168, 1, 12);
/// Both look at their sockets so often.
const STEP_NS: i64 = 5_000_000;
/// From power to readiness.
const BOOT_NS: i64 = SECOND;
/// Without heartbeats a device keeps a session for so long (first protocol).
const SESSION_NS: i64 = 5 * SECOND;

/// What is wrong with the way or the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wrong {
    Nothing,
    Cable,
    Deaf,
    Power,
}

struct Talk {
    session: Session,
    out: Outbox,
    device: LivoxMind,
    wrong: Wrong,
    /// The host's port for commands, by which a device knows it.
    port: u16,
    now: i64,
    tick_ns: i64,
    data_ns: i64,
}

impl Talk {
    fn new(protocol: Protocol, named: bool) -> Self {
        let of_device = match protocol {
            Protocol::Sdk1 => LivoxProtocol::Sdk1,
            Protocol::Sdk2 => LivoxProtocol::Sdk2,
        };
        let device = LivoxConfig {
            protocol: of_device,
            address: DEVICE,
            broadcast_to: HOST,
            boot_s: BOOT_NS as f64 * 1e-9,
            session_s: SESSION_NS as f64 * 1e-9,
            ..LivoxConfig::default()
        };
        Self {
            session: session(protocol, named, 50_000),
            out: Outbox::default(),
            device: LivoxMind::new(&device, 0),
            wrong: Wrong::Nothing,
            port: 50_000,
            now: BOOT_NS,
            tick_ns: 0,
            data_ns: 0,
        }
    }

    /// One step of time: everything that is said is heard in it, if it can be.
    fn step(&mut self) {
        self.now += STEP_NS;
        let (now, wrong) = (self.now, self.wrong);
        let mut heard: Vec<Vec<u8>> = Vec::new();
        if wrong != Wrong::Power {
            self.device.tick(now, |_, bytes| heard.push(bytes.to_vec()));
            if self.device.target(now).is_some() && wrong != Wrong::Cable {
                self.data_ns = now;
            }
        }
        loop {
            if wrong != Wrong::Cable {
                let from = SocketAddrV4::new(DEVICE, 65_000);
                for bytes in heard.drain(..) {
                    if self.session.receive(now, from, &bytes, &mut self.out) {
                        self.tick_ns = now;
                    }
                }
            }
            heard.clear();
            if now >= self.tick_ns {
                self.tick_ns = self.session.tick(now, self.data_ns, &mut self.out);
            }
            let mut said = Vec::new();
            self.out.drain(|_, _, bytes| said.push(bytes.to_vec()));
            if said.is_empty() && self.tick_ns > now {
                return;
            }
            for bytes in said.iter().filter(|_| wrong == Wrong::Nothing) {
                let from = SocketAddrV4::new(HOST, self.port);
                self.device.receive(now, from, bytes, |_, bytes| heard.push(bytes.to_vec()));
            }
        }
    }

    /// Lets time pass until `done`; how long that took.
    #[track_caller]
    fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) -> i64 {
        let began = self.now;
        while !done(self) {
            self.step();
            assert!(self.now - began < 60 * SECOND, "never: {what}; {:?}", self.session.view());
        }
        self.now - began
    }

    fn pass(&mut self, seconds: f64) {
        let end = self.now + (seconds * 1e9) as i64;
        while self.now < end {
            self.step();
        }
    }

    /// Whether points come, and the session knows.
    fn measures(&self) -> bool {
        self.data_ns == self.now && self.session.view().phase == Phase::Sampling
    }
}

fn session(protocol: Protocol, named: bool, port: u16) -> Session {
    let config = Config { protocol, interface: HOST, device: named.then_some(DEVICE), ..Config::default() };
    Session::new(&config, Host { address: HOST, command_port: port, data_port: port + 1 })
}

/// Devices that were named and, where they offer themselves, ones that were not.
const CASES: [(Protocol, bool); 3] =
    [(Protocol::Sdk1, true), (Protocol::Sdk1, false), (Protocol::Sdk2, true)];

/// Every phase of the conversation's rhythm, in which the fault may come.
fn moments() -> impl Iterator<Item = f64> {
    (0..20).map(|n| 4.0 + 0.05 * f64::from(n))
}

#[test]
fn a_device_that_is_there_measures_within_the_stated_time_of_the_start() {
    for (protocol, named) in CASES {
        let mut talk = Talk::new(protocol, named);
        let took = talk.until("points", Talk::measures);
        assert!(took <= RECOVERED_NS, "{protocol:?} {named}: {took} ns");
        talk.pass(30.0);
        assert_eq!((talk.session.view().sessions, talk.session.view().lost), (1, None));
    }
}

#[test]
fn a_pulled_cable_a_deaf_device_and_no_power_are_noticed_and_over_within_the_stated_times() {
    for (protocol, named) in CASES {
        for wrong in [Wrong::Cable, Wrong::Deaf, Wrong::Power] {
            if (protocol, wrong) == (Protocol::Sdk2, Wrong::Deaf) {
                // It measures and pushes its state, and needs nothing.
                continue;
            }
            for at_s in moments() {
                let mut talk = Talk::new(protocol, named);
                talk.pass(at_s);
                assert!(talk.measures());
                talk.wrong = wrong;
                let noticed = talk.until("the loss", |talk| talk.session.view().lost.is_some());
                assert!(noticed <= NOTICED_NS, "{protocol:?} {wrong:?} at {at_s} s: {noticed} ns");
                // Longer than a device keeps a session.
                talk.pass(6.0);
                if wrong == Wrong::Power {
                    talk.device.power_cycle(talk.now);
                }
                talk.wrong = Wrong::Nothing;
                let boot_ns = if wrong == Wrong::Power { BOOT_NS } else { 0 };
                let took = talk.until("points", Talk::measures) - boot_ns;
                assert!(took <= RECOVERED_NS, "{protocol:?} {named} {wrong:?} at {at_s} s: {took} ns");
                assert_eq!(talk.session.view().sessions, 2);
            }
        }
    }
}

#[test]
fn a_power_cycle_shorter_than_the_driver_s_patience_is_over_as_soon() {
    for (protocol, named) in CASES {
        for at_s in moments() {
            let mut talk = Talk::new(protocol, named);
            talk.pass(at_s);
            talk.wrong = Wrong::Power;
            talk.pass(0.5);
            talk.device.power_cycle(talk.now);
            talk.wrong = Wrong::Nothing;
            let took =
                talk.until("points", |talk| talk.session.view().sessions == 2 && talk.measures()) - BOOT_NS;
            assert!(took <= RECOVERED_NS, "{protocol:?} {named} at {at_s} s: {took} ns");
        }
    }
}

#[test]
fn a_host_that_restarts_measures_within_the_stated_time_of_the_device_s_giving_the_old_session_up() {
    for (protocol, named) in CASES {
        for at_s in moments() {
            let mut talk = Talk::new(protocol, named);
            talk.pass(at_s);
            // Nobody has said good-bye, and the new process has other ports: the device does not know it.
            talk.port = 51_000;
            (talk.session, talk.tick_ns) = (session(protocol, named, talk.port), 0);
            let took = talk.until("points", Talk::measures);
            let held = if protocol == Protocol::Sdk1 { SESSION_NS } else { 0 };
            assert!(took <= held + RECOVERED_NS, "{protocol:?} {named} at {at_s} s: {took} ns");
        }
    }
}

#[test]
fn the_document_states_the_times_that_are_tested() {
    let document = include_str!("../../../../docs/devices.md");
    let stated = format!("noticed in {} s; data in {} s", NOTICED_NS / SECOND, RECOVERED_NS / SECOND);
    assert_eq!(document.matches(&stated).count(), 3, "{stated}");
    assert!(document.contains(&format!("| data in {} s |", RECOVERED_NS / SECOND)));
}
