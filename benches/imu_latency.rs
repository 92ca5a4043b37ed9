//! From a sample's last byte on the serial line to the published sample: a pseudo-terminal, the driver, shared memory. See
//! benches/README.md for what is timed. Belongs to the crate `evac-imu`, so that it builds without the other stages.
#![allow(clippy::expect_used, reason = "criterion's closures cannot return errors")]

mod support;

use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use criterion::{Criterion, SamplingMode};
use evac_formats::wt901c::{encode_accel, encode_gyro, encode_time};
use evac_imu::{Config, Imu};
use evac_ports::services::Imu as ImuService;
use evac_ports::{Bus, Domain, RecordSubscriber};
use evac_stage::{Device as _, ImuOutput, Reporter, Rig, StageOutput as _};
use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use crate::support::{Distribution, print_heading};

const PERIOD: Duration = Duration::from_millis(5);
/// Samples until the driver knows rate and clock.
const SETTLING: u64 = 500;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut criterion = Criterion::default().configure_from_args();
    let domain = Domain::new(&format!("bench-{}", std::process::id()))?;
    let _lock = domain.lock()?;
    let bus = Bus::join(&domain, "bench")?;
    let mut line = Line::open(&bus)?;
    let mut times = Distribution::default();
    let mut group = criterion.benchmark_group("imu_latency");
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(10));
    group.bench_function("byte to published sample", |bencher| {
        bencher.iter_custom(|samples| {
            line.settle();
            let mut total = Duration::ZERO;
            for _ in 0..samples {
                let took = line.sample().expect("a sample is published");
                times.record(took.as_nanos() as i64);
                total += took;
            }
            total
        });
    });
    group.finish();
    criterion.final_summary();
    print_heading("one IMU sample");
    if let Some(summary) = times.summary() {
        println!("{:<34} {summary}", "byte to published sample");
    }
    Ok(())
}

/// The module's end of a line, and the driver at the other.
struct Line {
    master: OwnedFd,
    driver: Imu,
    output: ImuOutput,
    reporter: Reporter,
    /// Somebody to publish for.
    reader: RecordSubscriber<ImuService>,
    due: Instant,
    sent: u64,
}

impl Line {
    fn open(bus: &Bus) -> Result<Self, Box<dyn std::error::Error>> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        unlockpt(&master)?;
        let mut settings = tcgetattr(&master)?;
        settings.make_raw();
        tcsetattr(&master, OptionalActions::Now, &settings)?;
        let port = ptsname(&master, Vec::new())?.into_string()?.into();
        // A module that is set already: the driver listens.
        let config = Config { port, configure: false, ..Config::default() };
        let (reader, _) = RecordSubscriber::open(bus)?;
        Ok(Self {
            master,
            driver: Imu::new(config, &Rig::default())?,
            output: ImuOutput::open(bus, 0)?,
            reporter: Reporter::detached(),
            reader,
            due: Instant::now(),
            sent: 0,
        })
    }

    /// Sends samples until the driver publishes them.
    fn settle(&mut self) {
        self.due = Instant::now();
        while self.sent < SETTLING {
            let _ = self.sample();
        }
    }

    /// Waits until the next sample is due, sends it and lets the driver work; how long that took, where one was published.
    fn sample(&mut self) -> Option<Duration> {
        std::thread::sleep(self.due.saturating_duration_since(Instant::now()));
        self.due += PERIOD;
        let time_ns = 1_795_271_645_000_000_000 + self.sent as i64 * PERIOD.as_nanos() as i64;
        let mut bytes = encode_time(time_ns)?.to_vec();
        bytes.extend(encode_accel([3, -2, 2048], 2500));
        bytes.extend(encode_gyro([1, 0, (self.sent % 3) as i16], 500));
        self.sent += 1;
        let start = Instant::now();
        rustix::io::write(&self.master, &bytes).ok()?;
        self.driver.serve(&mut self.output, &mut self.reporter, PERIOD).ok()?;
        let took = start.elapsed();
        self.reader.receive().ok().flatten().map(|_| took)
    }
}
