//! From a sample's last byte on the serial line to the published sample: a pseudo-terminal, the driver, shared memory. See
//! benches/README.md for what is timed. Belongs to the crate `evac-imu`, so that it builds without the other stages.
#![allow(clippy::expect_used, reason = "criterion's closures cannot return errors")]

mod support;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use criterion::{Criterion, SamplingMode};
use evac_formats::wt901c::{encode_accel, encode_gyro, encode_time};
use evac_imu::{Config, Imu};
use evac_ports::services::Imu as ImuService;
use evac_ports::{Bus, Domain, RecordSubscriber, now_ns};
use evac_stage::{Device as _, ImuOutput, Reporter, Rig, StageOutput as _};
use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use crate::support::{Distribution, is_trial, print_heading};

const PERIOD: Duration = Duration::from_millis(5);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut criterion = Criterion::default().configure_from_args();
    // Samples of one of criterion's iterations.
    let block = if is_trial() { 1 } else { 100 };
    let domain = Domain::new(&format!("bench-{}", std::process::id()))?;
    let _lock = domain.lock()?;
    let bus = Bus::join(&domain, "bench")?;
    let mut line = Line::open(&bus)?;
    // Until the driver knows rate and clock.
    line.sample();
    let mut times = Distribution::default();
    let mut group = criterion.benchmark_group("imu_latency");
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(20));
    group.bench_function("byte to published sample", |bencher| {
        bencher.iter_custom(|blocks| {
            let mut total = Duration::ZERO;
            for _ in 0..blocks * block {
                let took = line.sample();
                times.record(took.as_nanos() as i64);
                total += took;
            }
            total / block as u32
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

/// A module in a thread of its own, the driver, and somebody it publishes for.
struct Line {
    driver: Imu,
    output: ImuOutput,
    reporter: Reporter,
    reader: RecordSubscriber<ImuService>,
    /// When the newest sample's bytes were given to the line.
    written_ns: Arc<AtomicI64>,
    stop: Arc<AtomicBool>,
    module: Option<JoinHandle<()>>,
}

impl Line {
    fn open(bus: &Bus) -> Result<Self, Box<dyn std::error::Error>> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        unlockpt(&master)?;
        let mut settings = tcgetattr(&master)?;
        settings.make_raw();
        tcsetattr(&master, OptionalActions::Now, &settings)?;
        let port = ptsname(&master, Vec::new())?.into_string()?.into();
        let (written_ns, stop) = (Arc::new(AtomicI64::new(0)), Arc::new(AtomicBool::new(false)));
        let (its_written_ns, its_stop) = (Arc::clone(&written_ns), Arc::clone(&stop));
        let module = std::thread::spawn(move || {
            let mut due = Instant::now();
            for sample in 0.. {
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
                due += PERIOD;
                let bytes = bytes_of(sample);
                its_written_ns.store(now_ns(), Ordering::Relaxed);
                if its_stop.load(Ordering::Relaxed) || rustix::io::write(&master, &bytes).is_err() {
                    return;
                }
            }
        });
        // A module that is set already: the driver listens.
        let config = Config { port, configure: false, ..Config::default() };
        let (reader, _) = RecordSubscriber::open(bus)?;
        Ok(Self {
            driver: Imu::new(config, &Rig::default())?,
            output: ImuOutput::open(bus, 0)?,
            reporter: Reporter::detached(),
            reader,
            written_ns,
            stop,
            module: Some(module),
        })
    }

    /// Lets the driver work until it has published a sample; the time since its bytes were given to the line.
    fn sample(&mut self) -> Duration {
        loop {
            self.driver.serve(&mut self.output, &mut self.reporter, PERIOD).expect("memory is enough");
            if self.reader.receive().expect("memory is enough").is_some() {
                let took = now_ns() - self.written_ns.load(Ordering::Relaxed);
                return Duration::from_nanos(took.max(0).unsigned_abs());
            }
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // A thread that has panicked has said so.
        let _ = self.module.take().map(JoinHandle::join);
    }
}

/// Time, accelerometer and gyroscope.
fn bytes_of(sample: i64) -> Vec<u8> {
    let time_ns = 1_795_271_645_000_000_000 + sample * PERIOD.as_nanos() as i64;
    let mut bytes: Vec<u8> = encode_time(time_ns).into_iter().flatten().collect();
    bytes.extend(encode_accel([3, -2, 2048], 2500));
    bytes.extend(encode_gyro([1, 0, (sample % 3) as i16], 500));
    bytes
}
