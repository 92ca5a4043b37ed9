//! The driver allocates nothing for a packet, and nothing for a scan.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::time::{Duration, Instant};

use common::{Host, configs};
use evac_lidar::{Config, Protocol};
use evac_simulator::devices::livox::{LivoxConfig, LivoxDevice, Wall};
use evac_stage::{Device as _, LidarOutput};
use evac_testkit::{CountingAllocator, count_allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn thousands_of_packets_and_their_scans_cost_no_allocation() {
    for protocol in [Protocol::Sdk1, Protocol::Sdk2] {
        let (device, config) = configs(protocol);
        let _device = LivoxDevice::start(LivoxConfig { imu: true, ..device }, Box::new(Wall)).unwrap();
        let mut host = Host::new(Config { publish_imu: true, ..config });
        host.scans(3);
        host.output = LidarOutput::newest_only();
        host.until("a first scan in the reused buffer", |host| {
            (!host.output.scans.memory.is_empty()).then_some(())
        });
        let (before, started) = (host.lidar.counts().used, Instant::now());
        let allocations = count_allocations(|| {
            // Three seconds: heartbeats, questions and their answers are in it.
            while started.elapsed() < Duration::from_secs(3) {
                host.lidar.serve(&mut host.output, &mut host.reporter, Duration::from_millis(50)).unwrap();
            }
        });
        let packets = host.lidar.counts().used - before;
        assert!(packets > 1000 && host.lidar.counts().imu > 200, "{:?}", host.lidar.counts());
        assert_eq!(allocations, 0, "{protocol:?}: for {packets} packets");
    }
}
