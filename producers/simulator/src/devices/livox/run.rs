//! The device's own thread: its sockets, and the time.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use evac_formats::livox_sdk2::ports;

use super::config::{LivoxConfig, LivoxProtocol, TimeSource};
use super::faults::{Faults, Faulty};
use super::mind::LivoxMind;
use super::scene::Scene;
use super::sender::Sender;
use crate::devices::now_ns;
use crate::{FRAME_NS, SAMPLE_NS};

/// Port of a device of the first protocol for commands.
const SDK1_COMMAND: u16 = 65000;
/// Port that a real device of the first protocol was seen to send points from.
const SDK1_POINTS: u16 = 60001;
/// Longest sleep while nothing is sent.
const NAP: Duration = Duration::from_millis(2);
/// Packets that are not sent within this time are left out, as a device that was stopped leaves them out.
const BACKLOG_NS: i64 = 500_000_000;

/// A device that runs until it is dropped.
#[derive(Debug)]
pub struct LivoxDevice {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What a device has sent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sent {
    /// Data packets, those included that faults have swallowed.
    pub packets: u64,
    /// Data packets that faults have swallowed.
    pub swallowed: u64,
    /// Samples of its own IMU, and those that faults have swallowed.
    pub samples: [u64; 2],
}

#[derive(Debug)]
struct Shared {
    stop: AtomicBool,
    faults: Mutex<Faults>,
    /// Power is off until then, host monotonic nanoseconds; 0 where it is on.
    off_until_ns: AtomicI64,
    source: Mutex<TimeSource>,
    /// When measuring first began, host monotonic nanoseconds; 0 before.
    began_ns: AtomicI64,
    packets: AtomicU64,
    swallowed: AtomicU64,
    samples: [AtomicU64; 2],
}

impl LivoxDevice {
    /// Powers a device on that measures `scene`.
    ///
    /// # Errors
    /// Where its address cannot be had.
    pub fn start(config: LivoxConfig, scene: Box<dyn Scene>) -> io::Result<Self> {
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            faults: Mutex::default(),
            off_until_ns: AtomicI64::new(0),
            source: Mutex::new(config.time_source),
            began_ns: AtomicI64::new(0),
            packets: AtomicU64::new(0),
            swallowed: AtomicU64::new(0),
            samples: [const { AtomicU64::new(0) }; 2],
        });
        let sockets = Sockets::open(&config)?;
        let running = Running::new(&config, sockets, scene, Arc::clone(&shared));
        let thread = std::thread::Builder::new().name("livox".to_owned()).spawn(move || running.run())?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Changes the faults.
    pub fn faults(&self, change: impl FnOnce(&mut Faults)) {
        change(&mut self.shared.faults.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Switches the power off, and on again after some time.
    pub fn power_cycle(&self, off: Duration) {
        self.power_off_until(now_ns() + off.as_nanos() as i64);
    }

    /// Switches the power off until then, nanoseconds of the host's monotonic clock.
    pub fn power_off_until(&self, until_ns: i64) {
        self.shared.off_until_ns.store(until_ns, Ordering::Relaxed);
    }

    /// Lets the clock follow another source.
    pub fn set_time_source(&self, source: TimeSource) {
        *self.shared.source.lock().unwrap_or_else(PoisonError::into_inner) = source;
    }

    /// When it first began to measure, nanoseconds of the host's monotonic clock: shot number 0.
    pub fn began_ns(&self) -> Option<i64> {
        Some(self.shared.began_ns.load(Ordering::Relaxed)).filter(|began| *began != 0)
    }

    /// What it has sent.
    pub fn sent(&self) -> Sent {
        Sent {
            packets: self.shared.packets.load(Ordering::Relaxed),
            swallowed: self.shared.swallowed.load(Ordering::Relaxed),
            samples: [0, 1].map(|i| self.shared.samples[i].load(Ordering::Relaxed)),
        }
    }
}

impl Drop for LivoxDevice {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked has said so itself.
            let _ = thread.join();
        }
    }
}

struct Sockets {
    command: UdpSocket,
    /// Searches of the second protocol.
    search: Option<UdpSocket>,
    /// Searches that are sent to all, which a socket bound to one address does not get.
    broadcast: Option<UdpSocket>,
    points: UdpSocket,
    /// IMU samples of the second protocol; the first sends them with the points.
    samples: Option<UdpSocket>,
}

impl Sockets {
    fn open(config: &LivoxConfig) -> io::Result<Self> {
        let open_at = |address| {
            let socket = UdpSocket::bind(address)
                .map_err(|cause| io::Error::new(cause.kind(), format!("UDP {address}: {cause}")))?;
            socket.set_nonblocking(true)?;
            socket.set_broadcast(true)?;
            Ok::<_, io::Error>(socket)
        };
        let open = |port| open_at(SocketAddrV4::new(config.address, port));
        let to_all = SocketAddrV4::new(Ipv4Addr::BROADCAST, ports::SEARCH);
        Ok(match config.protocol {
            LivoxProtocol::Sdk1 => {
                let (command, points) = (open(SDK1_COMMAND)?, open(SDK1_POINTS)?);
                Self { command, search: None, broadcast: None, points, samples: None }
            }
            LivoxProtocol::Sdk2 => Self {
                command: open(ports::COMMAND)?,
                search: Some(open(ports::SEARCH)?),
                broadcast: (!config.address.is_loopback()).then(|| open_at(to_all)).transpose()?,
                points: open(ports::POINTS)?,
                samples: Some(open(ports::IMU)?),
            },
        })
    }
}

struct Running {
    mind: LivoxMind,
    sockets: Sockets,
    sender: Sender,
    faulty: Faulty,
    faulty_samples: Faulty,
    shared: Arc<Shared>,
    powered_ns: i64,
    /// While it measures: host time and number of the next shot.
    next: Option<(i64, u64)>,
    /// Number of the next sample.
    next_sample: u64,
    packet: Vec<u8>,
    /// The scene has ended.
    is_over: bool,
}

impl Running {
    fn new(config: &LivoxConfig, sockets: Sockets, scene: Box<dyn Scene>, shared: Arc<Shared>) -> Self {
        let now = now_ns();
        Self {
            mind: LivoxMind::new(config, now),
            sockets,
            sender: Sender::new(config, scene),
            faulty: Faulty::new(1),
            faulty_samples: Faulty::new(2),
            shared,
            powered_ns: now,
            next: None,
            next_sample: 0,
            packet: Vec::new(),
            is_over: false,
        }
    }

    fn run(mut self) {
        while !self.shared.stop.load(Ordering::Relaxed) {
            let faults = *self.shared.faults.lock().unwrap_or_else(PoisonError::into_inner);
            self.sender.set_source(*self.shared.source.lock().unwrap_or_else(PoisonError::into_inner));
            let off_until = self.shared.off_until_ns.load(Ordering::Relaxed);
            let now = now_ns();
            if now < off_until {
                self.power_off(off_until);
                std::thread::sleep(NAP);
                continue;
            }
            self.converse(now, &faults);
            self.measure(now, &faults);
            let due = self.next.map_or(i64::MAX, |(next_ns, _)| next_ns + self.sender.packet_ns());
            let pause = due.saturating_sub(now_ns()).clamp(0, NAP.as_nanos() as i64);
            std::thread::sleep(Duration::from_nanos(pause.unsigned_abs()));
        }
    }

    /// Hears nothing and begins anew when the power is back.
    fn power_off(&mut self, until_ns: i64) {
        self.next = None;
        self.powered_ns = until_ns;
        self.mind.power_cycle(until_ns);
        self.sockets.hear(|_, _, _| {});
    }

    fn converse(&mut self, now: i64, faults: &Faults) {
        let mind = &mut self.mind;
        mind.set_status(faults.status);
        self.sender.status = faults.status;
        self.sockets.hear(|socket, from, bytes| {
            if faults.cable_out || faults.deaf {
                return;
            }
            mind.receive(now, from, bytes, |to, bytes| say(socket, to, bytes));
        });
        let command = &self.sockets.command;
        mind.tick(now, |to, bytes| {
            if !faults.cable_out {
                say(command, to, bytes);
            }
        });
    }

    /// Sends every packet whose last shot is over.
    fn measure(&mut self, now: i64, faults: &Faults) {
        let Some(target) = self.mind.target(now).filter(|_| !self.is_over) else {
            self.next = None;
            return;
        };
        let (mut next_ns, mut shot) = self.next.unwrap_or_else(|| self.begin(now));
        let (packet_ns, packet_shots) = (self.sender.packet_ns(), self.sender.packet_shots() as u64);
        while next_ns + packet_ns <= now {
            self.samples(next_ns + packet_ns, now, faults);
            if now - next_ns < BACKLOG_NS {
                let (power_on_ns, utc_ns) = self.clocks(next_ns, faults);
                if !self.sender.packet(shot, power_on_ns, utc_ns, &mut self.packet) {
                    self.is_over = true;
                    break;
                }
                let points = &self.sockets.points;
                let lost = if faults.cable_out {
                    1
                } else {
                    self.faulty.send(faults, &mut self.packet, |bytes| say(points, target, bytes))
                };
                self.shared.packets.fetch_add(1, Ordering::Relaxed);
                self.shared.swallowed.fetch_add(lost, Ordering::Relaxed);
            }
            next_ns += packet_ns;
            shot += packet_shots;
        }
        self.samples(now, now, faults);
        self.next = Some((next_ns, shot));
    }

    /// Sends every sample of the device's own IMU that is measured up to `until_ns`.
    fn samples(&mut self, until_ns: i64, now: i64, faults: &Faults) {
        let target = self.mind.imu_target(now);
        let began = self.shared.began_ns.load(Ordering::Relaxed);
        loop {
            let due_ns = began + self.next_sample as i64 * SAMPLE_NS;
            if due_ns > until_ns {
                return;
            }
            let number = self.next_sample;
            self.next_sample += 1;
            let Some(target) = target.filter(|_| now - due_ns < BACKLOG_NS) else { continue };
            let (power_on_ns, utc_ns) = self.clocks(due_ns, faults);
            if !self.sender.sample(number, power_on_ns, utc_ns, &mut self.packet) {
                return;
            }
            let socket = self.sockets.samples.as_ref().unwrap_or(&self.sockets.points);
            let lost = if faults.cable_out {
                1
            } else {
                self.faulty_samples.send(faults, &mut self.packet, |bytes| say(socket, target, bytes))
            };
            self.shared.samples[0].fetch_add(1, Ordering::Relaxed);
            self.shared.samples[1].fetch_add(lost, Ordering::Relaxed);
        }
    }

    /// What the device's clock shows at a host time: since power-on, and UTC.
    fn clocks(&self, host_ns: i64, faults: &Faults) -> (i64, i64) {
        let step_ns = (faults.clock_step_ms * 1e6) as i64;
        ((host_ns - self.powered_ns + step_ns).max(0), host_ns + utc_ahead_ns() + step_ns)
    }

    /// Measuring begins at a whole tenth of a second of the device's clock, or goes on with the shot that is due by now: the
    /// world does not wait for a device.
    fn begin(&self, now: i64) -> (i64, u64) {
        let packet_ns = self.sender.packet_ns();
        let first = now + (self.powered_ns - now).rem_euclid(FRAME_NS);
        let began = match self.shared.began_ns.load(Ordering::Relaxed) {
            0 => first,
            began => began,
        };
        self.shared.began_ns.store(began, Ordering::Relaxed);
        let packets = (now - began).max(0) / packet_ns;
        (began + packets * packet_ns, packets.unsigned_abs() * self.sender.packet_shots() as u64)
    }
}

impl Sockets {
    fn hear(&self, mut heard: impl FnMut(&UdpSocket, SocketAddrV4, &[u8])) {
        let mut buffer = [0; 2048];
        // Where it is heard, and by which it is answered.
        let search = self.search.as_ref();
        let ears =
            [(Some(&self.command), Some(&self.command)), (search, search), (self.broadcast.as_ref(), search)];
        for (ear, mouth) in ears.into_iter().filter_map(|(ear, mouth)| ear.zip(mouth)) {
            for _ in 0..32 {
                let Ok((length, SocketAddr::V4(from))) = ear.recv_from(&mut buffer) else { break };
                heard(mouth, from, buffer.get(..length).unwrap_or_default());
            }
        }
    }
}

/// What nobody receives is lost, as on a real network.
fn say(socket: &UdpSocket, to: SocketAddrV4, bytes: &[u8]) {
    let _ = socket.send_to(bytes, to);
}

/// UTC less the host's monotonic clock, nanoseconds; the same for all packets of a process, so that both run alike.
fn utc_ahead_ns() -> i64 {
    static AHEAD: std::sync::OnceLock<i64> = std::sync::OnceLock::new();
    *AHEAD.get_or_init(|| {
        let utc = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        utc.as_nanos() as i64 - now_ns()
    })
}
