//! The IMU inside a LiDAR, passed on beside the points.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::time::Duration;

use common::{Host, configs, shot};
use evac_frames::{ImuSample, frame_flags};
use evac_lidar::{Config, Protocol};
use evac_simulator::devices::livox::{Faults, LivoxConfig, LivoxDevice, TimeSource, Wall};
use evac_stage::Device as _;

const BOTH: [Protocol; 2] = [Protocol::Sdk1, Protocol::Sdk2];

/// A device with an IMU that sees a wall, and a driver that passes its samples on.
fn pair(protocol: Protocol) -> (LivoxDevice, Host) {
    let (device, config) = configs(protocol);
    let device = LivoxDevice::start(LivoxConfig { imu: true, ..device }, Box::new(Wall)).unwrap();
    (device, Host::new(Config { publish_imu: true, ..config }))
}

/// Number of a sample of the [`Wall`].
fn number(sample: &ImuSample) -> u64 {
    (sample.gyro[0] * 1e3).round() as u64
}

/// Every sample once, in order, evenly, in SI units.
#[track_caller]
fn assert_even(samples: &[ImuSample]) {
    for pair in samples.windows(2) {
        assert_eq!((pair[1].seq, number(&pair[1])), (pair[0].seq + 1, number(&pair[0]) + 1));
        let period_ns = pair[1].stamp_ns - pair[0].stamp_ns;
        assert!((4_940_000..5_060_000).contains(&period_ns), "{period_ns}");
        assert!(pair[1].arrival_ns > pair[1].stamp_ns - 5_000_000 && pair[1].sent_ns >= pair[1].arrival_ns);
        assert!((pair[1].accel[2] - 9.80665).abs() < 1e-6, "{:?}", pair[1]);
    }
}

#[test]
fn samples_come_in_si_units_on_the_same_clock_as_the_points() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        let scans = host.scans(12);
        let samples = host.output.imu.memory.clone();
        assert!(samples.len() > 200, "{}", samples.len());
        assert_even(&samples);
        // Shot 0 and sample 0 were measured when measuring began. The points' clock and the samples' are one, so both are off
        // that by the same; a scan's start was fixed one scan ago, and the fit moves by a hundredth of that time at most.
        let began = device.began_ns().unwrap();
        let (header, points) = scans.last().unwrap();
        let points_off_ns = header.frame.start_ns - (began + shot(&points[0]) as i64 * 10_000);
        let sample = samples.last().unwrap();
        let sample_off_ns = sample.stamp_ns - (began + number(sample) as i64 * 5_000_000);
        assert!((sample_off_ns - points_off_ns).abs() < 1_300_000, "{sample_off_ns} {points_off_ns} ns");
        let counts = host.lidar.counts();
        assert_eq!((counts.imu_lost, counts.late, counts.damaged), (0, 0, 0), "{protocol:?}: {counts:?}");
        host.lidar.finish(&mut host.output).unwrap();
        assert_eq!(host.output.imu.memory.last().unwrap().flags, frame_flags::END_OF_STREAM);
    }
}

#[test]
fn samples_stay_even_whatever_the_device_s_clock_follows() {
    let (device, mut host) = pair(Protocol::Sdk1);
    host.scans(2);
    for (changes, source) in [(1, TimeSource::Ptp), (2, TimeSource::Gps), (3, TimeSource::Pulse)] {
        device.set_time_source(source);
        host.until_noted(&["sampling", &format!("{changes} clock steps")]);
        let before = host.output.imu.memory.len();
        host.scans(13);
        let samples = &host.output.imu.memory[before + 1..];
        assert!(samples.len() > 100, "{source:?}: {}", samples.len());
        assert_even(samples);
        let off_ns =
            samples[0].stamp_ns - (device.began_ns().unwrap() + number(&samples[0]) as i64 * 5_000_000);
        assert!((-1_000_000..5_000_000).contains(&off_ns), "{source:?}: {off_ns} ns");
    }
}

#[test]
fn lost_repeated_and_overtaken_samples_are_counted_and_the_rest_is_in_order() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(3);
        device.faults(|faults| {
            (faults.lost_share, faults.repeated_share, faults.late_share) = (0.05, 0.05, 0.05);
        });
        host.scans(30);
        device.faults(|faults| *faults = Faults::default());
        host.scans(2);
        let (counts, [_, swallowed]) = (host.lidar.counts(), device.sent().samples);
        assert!(swallowed > 5 && counts.imu_lost >= swallowed, "{protocol:?}: {swallowed} {counts:?}");
        let samples = &host.output.imu.memory;
        assert!(samples.windows(2).all(|pair| number(&pair[0]) < number(&pair[1])), "{protocol:?}");
        assert!(samples.windows(2).all(|pair| pair[0].stamp_ns < pair[1].stamp_ns), "{protocol:?}");
        let missing = number(samples.last().unwrap()) - number(&samples[0]) + 1 - samples.len() as u64;
        assert_eq!(missing, counts.imu_lost, "{protocol:?}");
        assert_eq!(host.reporter.input.imu_lost, counts.imu_lost);
        host.until_noted(&["sampling", "IMU samples lost"]);
    }
}

#[test]
fn samples_go_on_after_a_power_cycle_and_the_time_without_power_is_no_loss() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(3);
        device.power_cycle(Duration::from_secs(1));
        host.until_noted(&["sampling", "session 2"]);
        let before = host.output.imu.memory.len();
        host.scans(4);
        let samples = &host.output.imu.memory;
        assert!(samples.len() > before + 40, "{protocol:?}");
        assert!(samples.windows(2).all(|pair| pair[0].stamp_ns < pair[1].stamp_ns), "{protocol:?}");
        // The last ones before the power went may be missing.
        assert!(host.lidar.counts().imu_lost < 50, "{protocol:?}: {:?}", host.lidar.counts());
    }
}

#[test]
fn a_device_without_an_imu_is_told_from_one_whose_samples_do_not_come() {
    for protocol in BOTH {
        let (device, config) = configs(protocol);
        let _device = LivoxDevice::start(device, Box::new(Wall)).unwrap();
        let mut host = Host::new(Config { publish_imu: true, ..config });
        host.scans(2);
        host.until_noted(&["no IMU samples: has this LiDAR an IMU?"]);
        assert!(host.output.imu.memory.is_empty());
    }
}

#[test]
fn without_a_wish_for_samples_the_device_is_told_to_send_none() {
    for protocol in BOTH {
        let (device, config) = configs(protocol);
        let device = LivoxDevice::start(LivoxConfig { imu: true, ..device }, Box::new(Wall)).unwrap();
        let mut host = Host::new(config);
        host.scans(5);
        assert_eq!((device.sent().samples, host.lidar.counts().imu), ([0, 0], 0), "{protocol:?}");
        assert!(host.output.imu.memory.is_empty());
    }
}
