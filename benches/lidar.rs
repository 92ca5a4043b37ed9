//! The LiDAR's driver: from the arrival of a scan's last packet on the socket to the scan in shared memory. See
//! benches/README.md for what is timed.
#![allow(clippy::expect_used)] // criterion's closures cannot return errors

mod support;

use std::net::Ipv4Addr;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, Throughput};
use evac_lidar::{Config, Lidar, Protocol};
use evac_ports::services::LidarScan;
use evac_ports::{Bus, Domain, FrameSubscriber};
use evac_simulator::devices::livox::{LivoxConfig, LivoxDevice, LivoxProtocol, Wall};
use evac_stage::{Device as _, LidarOutput, Reporter, Rig, StageOutput as _};

use crate::support::{Distribution, print_heading};

/// Longest wait within the driver.
const PATIENCE: Duration = Duration::from_millis(50);

fn main() -> anyhow::Result<()> {
    let mut criterion = Criterion::default().configure_from_args();
    let results = [
        lidar(&mut criterion, "lidar, SDK1", Protocol::Sdk1, LivoxProtocol::Sdk1, 2)?,
        lidar(&mut criterion, "lidar, SDK2", Protocol::Sdk2, LivoxProtocol::Sdk2, 4)?,
    ];
    criterion.final_summary();
    print_heading("last packet of a scan to the scan in shared memory");
    for (name, distribution, lost) in &results {
        if let Some(summary) = distribution.summary() {
            println!("{name:<34} {summary}   {lost} packets lost");
        }
    }
    Ok(())
}

fn lidar(
    criterion: &mut Criterion,
    name: &'static str,
    protocol: Protocol,
    of_device: LivoxProtocol,
    host: u8,
) -> anyhow::Result<(&'static str, Distribution, u64)> {
    let [_, _, b, c] = std::process::id().to_be_bytes();
    let (interface, device) = (Ipv4Addr::new(127, host | 0x10, b, c), Ipv4Addr::new(127, host | 0x11, b, c));
    let domain = Domain::new(&format!("bench-lidar-{host}-{}", std::process::id()))?;
    let _lock = domain.lock()?;
    let bus = Bus::join(&domain, "lidar")?;
    let (scans, _) = FrameSubscriber::<LidarScan>::open(&bus)?;
    let mut output = LidarOutput::open(&bus, 0)?;
    let mut reporter = Reporter::detached();
    let config = LivoxConfig {
        protocol: of_device,
        address: device,
        broadcast_to: interface,
        ..LivoxConfig::default()
    };
    let _device = LivoxDevice::start(config, Box::new(Wall))?;
    let mut lidar = Lidar::new(
        Config { protocol, interface, device: Some(device), ..Config::default() },
        &Rig::default(),
    )?;
    let mut times = Distribution::default();

    // Finding the device and fitting its clock takes seconds, of which criterion need not know.
    while scans.receive()?.is_none() {
        lidar.serve(&mut output, &mut reporter, PATIENCE)?;
    }

    let mut group = criterion.benchmark_group("lidar");
    group.sampling_mode(SamplingMode::Flat).sample_size(10).throughput(Throughput::Elements(10_000));
    group.bench_function(name, |bencher| {
        bencher.iter_custom(|count| {
            let (mut total, mut left) = (Duration::ZERO, count);
            while left > 0 {
                lidar.serve(&mut output, &mut reporter, PATIENCE).expect("the driver serves");
                while let Some(scan) = scans.receive().expect("scans are received") {
                    let frame = &scan.header().frame;
                    let took = frame.sent_ns - frame.arrival_ns;
                    times.record(took);
                    total += Duration::from_nanos(took.unsigned_abs());
                    left = left.saturating_sub(1);
                }
            }
            total
        });
    });
    group.finish();
    Ok((name, times, lidar.counts().lost))
}
