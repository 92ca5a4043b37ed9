//! A driver and a simulated device on loopback addresses of their own; a watchdog on each wait.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses some of it")]

use std::net::Ipv4Addr;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use evac_frames::{Point, ScanHeader};
use evac_lidar::{Config, Lidar, Protocol};
use evac_simulator::devices::livox::{LivoxConfig, LivoxDevice, LivoxProtocol, Wall};
use evac_stage::{Device as _, LidarOutput, Reporter, Rig};

/// A test that hangs is ended after this; nothing is asserted about how fast anything is.
const WATCHDOG: Duration = Duration::from_secs(60);

/// Addresses of host and device that no other test uses, in this process or another.
pub(crate) fn addresses() -> [Ipv4Addr; 2] {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let number = (std::process::id() << 5 | COUNTER.fetch_add(1, Ordering::Relaxed) & 0x1f) & 0x3f_ffff;
    let [_, a, b, c] = (number << 1).to_be_bytes();
    [Ipv4Addr::new(127, a | 0x80, b, c), Ipv4Addr::new(127, a | 0x80, b, c | 1)]
}

/// A driver that runs in the test's own thread.
pub(crate) struct Host {
    pub(crate) lidar: Lidar,
    pub(crate) output: LidarOutput,
    pub(crate) reporter: Reporter,
    pub(crate) config: Config,
}

impl Host {
    pub(crate) fn new(config: Config) -> Self {
        Self {
            lidar: Lidar::new(config.clone(), &Rig::default()).unwrap(),
            output: LidarOutput::default(),
            reporter: Reporter::detached(),
            config,
        }
    }

    /// Serves until `done` gives something.
    #[track_caller]
    pub(crate) fn until<T>(&mut self, what: &str, mut done: impl FnMut(&mut Self) -> Option<T>) -> T {
        let started = Instant::now();
        loop {
            self.lidar.serve(&mut self.output, &mut self.reporter, Duration::from_millis(50)).unwrap();
            if let Some(found) = done(self) {
                return found;
            }
            assert!(
                started.elapsed() < WATCHDOG,
                "the watchdog ended the wait for {what}: '{}', {:?}",
                self.reporter.noted(),
                self.lidar.counts()
            );
        }
    }

    /// Waits for so many more scans, and gives them.
    #[track_caller]
    pub(crate) fn scans(&mut self, count: usize) -> Vec<(ScanHeader, Vec<Point>)> {
        let before = self.output.scans.memory.len();
        self.until("scans", |host| (host.output.scans.memory.len() >= before + count).then_some(()));
        self.output.scans.memory[before..].to_vec()
    }

    /// Waits until health says all these words.
    #[track_caller]
    pub(crate) fn until_noted(&mut self, words: &[&str]) {
        self.until(&format!("health to say {words:?}"), |host| {
            let noted = host.reporter.noted();
            words.iter().all(|word| noted.contains(word)).then_some(())
        });
    }
}

/// A device that sees a wall, and a driver for it.
pub(crate) fn pair(protocol: Protocol) -> (LivoxDevice, Host) {
    let (device, config) = configs(protocol);
    (LivoxDevice::start(device, Box::new(Wall)).unwrap(), Host::new(config))
}

/// Configurations of a device and of a driver that is told its address.
pub(crate) fn configs(protocol: Protocol) -> (LivoxConfig, Config) {
    let [host, device] = addresses();
    let of_device = match protocol {
        Protocol::Sdk1 => LivoxProtocol::Sdk1,
        Protocol::Sdk2 => LivoxProtocol::Sdk2,
    };
    (
        LivoxConfig {
            protocol: of_device,
            address: device,
            broadcast_to: host,
            boot_s: 0.3,
            session_s: 2.0,
            ..LivoxConfig::default()
        },
        Config { protocol, interface: host, device: Some(device), ..Config::default() },
    )
}

/// Number of the shot that a point of the [`Wall`] is of.
pub(crate) fn shot(point: &Point) -> u64 {
    let mm = |metres: f32| (f64::from(metres) * 1e3).round() as u64;
    (mm(point.z) - 1) * 100_000 + mm(point.y)
}

/// Every point of the scans is the wall's, in order, at its own time; scans follow each other without a gap.
#[track_caller]
pub(crate) fn assert_gap_free(scans: &[(ScanHeader, Vec<Point>)]) {
    let mut last: Option<(u64, i64)> = None;
    for (header, points) in scans {
        assert_eq!((header.points as usize, header.lost_packets, header.no_return), (points.len(), 0, 0));
        assert!(header.frame.sent_ns >= header.frame.arrival_ns && header.frame.arrival_ns > 0);
        let first = shot(&points[0]);
        for (n, point) in points.iter().enumerate() {
            assert_eq!(shot(point), first + n as u64);
            assert_eq!((point.offset_ns(), point.reflectivity()), (n as i64 * 10_000, 80));
        }
        if let Some((shot, end_ns)) = last {
            assert_eq!((first, header.frame.start_ns), (shot, end_ns));
        }
        last = Some((first + points.len() as u64, header.frame.end_ns));
    }
}
