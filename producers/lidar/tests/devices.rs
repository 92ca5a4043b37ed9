//! The driver against devices that answer on real sockets: what it delivers, and how it comes back from what happens to robots.
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::net::UdpSocket;
use std::time::Duration;

use common::{Host, assert_gap_free, configs, pair, shot};
use evac_frames::{DeviceKind, NO_TEMPERATURE};
use evac_lidar::{Config, Protocol};
use evac_simulator::devices::livox::{Faults, LivoxConfig, LivoxDevice, TimeSource, Wall};
use evac_stage::Device as _;

const BOTH: [Protocol; 2] = [Protocol::Sdk1, Protocol::Sdk2];

#[test]
fn scans_hold_every_shot_once_at_its_time_on_the_host_s_clock() {
    // 104 or 105 packets of 96 shots come nearest to a tenth of a second.
    for (protocol, allowed) in [(Protocol::Sdk1, [10_000; 2]), (Protocol::Sdk2, [9984, 10_080])] {
        let (device, mut host) = pair(protocol);
        let scans = host.scans(12);
        assert_gap_free(&scans[1..]);
        for (n, (header, _)) in scans.iter().enumerate() {
            assert!(header.frame.seq == n as u64 && allowed.contains(&header.points), "{header:?}");
        }
        // Shot 0 was measured when measuring began; the fit is good to the little that the way over the loopback takes.
        let began = device.began_ns().unwrap();
        let (header, points) = scans.last().unwrap();
        let off_ns = header.frame.start_ns - (began + shot(&points[0]) as i64 * 10_000);
        assert!((-100_000..5_000_000).contains(&off_ns), "{off_ns} ns");
        let counts = host.lidar.counts();
        assert_eq!((counts.lost, counts.late, counts.strangers, counts.damaged), (0, 0, 0, 0), "{counts:?}");
        host.until_noted(&["sampling"]);
    }
}

#[test]
fn a_device_that_broadcasts_is_found_without_its_address_and_one_with_another_code_is_not() {
    let (device, config) = configs(Protocol::Sdk1);
    let serial = device.serial.clone();
    let _device = LivoxDevice::start(device, Box::new(Wall)).unwrap();
    let mut other = Host::new(Config { device: None, serial: Some("1HDDH1200100421".to_owned()), ..config });
    let mut broadcasts = 0;
    other.until("two broadcasts", |host| {
        broadcasts = broadcasts.max(host.lidar.counts().damaged);
        (broadcasts >= 2).then_some(())
    });
    other.until_noted(&["no LiDAR answers"]);
    drop(other);
    let mut host = Host::new(Config { device: None, serial: Some(serial), ..config });
    assert_gap_free(&host.scans(3)[1..]);
}

#[test]
fn the_length_of_a_scan_is_what_was_asked_for() {
    for (frame_ms, points) in [(10.0, 1000), (50.0, 5000), (150.0, 15_000)] {
        let (device, config) = configs(Protocol::Sdk1);
        let _device = LivoxDevice::start(device, Box::new(Wall)).unwrap();
        let mut host = Host::new(Config { frame_ms, ..config });
        let scans = host.scans(4);
        assert!(scans.iter().all(|(header, _)| header.points == points), "{frame_ms}");
        assert_gap_free(&scans[1..]);
    }
}

#[test]
fn a_power_cycle_ends_the_session_and_begins_another_by_itself() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(3);
        device.power_cycle(Duration::from_secs(1));
        host.until_noted(&["sampling", "session 2"]);
        let scans = host.scans(4);
        assert_gap_free(&scans[2..]);
        let stamps: Vec<_> = host.output.scans.memory.iter().map(|(header, _)| header.frame.end_ns).collect();
        assert!(stamps.is_sorted(), "{protocol:?}: {stamps:?}");
        // Sequence numbers have no gap: the scans that did not come were never made.
        assert!(
            host.output.scans.memory.iter().enumerate().all(|(n, (header, _))| header.frame.seq == n as u64)
        );
    }
}

#[test]
fn a_host_that_restarts_while_the_device_holds_the_old_session_gets_a_new_one() {
    for protocol in BOTH {
        let (_device, mut host) = pair(protocol);
        host.scans(2);
        let config = host.config.clone();
        // As after a power cut of the host: nobody says good-bye.
        drop(host);
        let mut host = Host::new(config);
        if protocol == Protocol::Sdk1 {
            host.until_noted(&["may hold an old one"]);
        }
        host.until_noted(&["sampling"]);
        assert_gap_free(&host.scans(3)[1..]);
    }
}

#[test]
fn a_host_that_ends_frees_the_device_for_the_next_at_once() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(2);
        host.lidar.finish(&mut host.output).unwrap();
        std::thread::sleep(Duration::from_millis(100));
        let sent = device.sent();
        std::thread::sleep(Duration::from_millis(200));
        assert_eq!(device.sent(), sent, "{protocol:?}: it still measures");
    }
}

#[test]
fn lost_heartbeats_end_the_session_and_the_next_begins_when_the_device_hears_again() {
    for (session_s, why) in [(20.0, "no answer for 3 s"), (1.0, "ended by the device")] {
        let (device, config) = configs(Protocol::Sdk1);
        let device = LivoxDevice::start(LivoxConfig { session_s, ..device }, Box::new(Wall)).unwrap();
        let mut host = Host::new(config);
        host.scans(2);
        device.faults(|faults| faults.deaf = true);
        host.until_noted(&["asking", why]);
        device.faults(|faults| faults.deaf = false);
        host.until_noted(&["sampling", &format!("session 2: {why}")]);
        assert_gap_free(&host.scans(3)[2..]);
    }
}

#[test]
fn a_pulled_cable_is_noticed_and_data_goes_on_when_it_is_back() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(2);
        device.faults(|faults| faults.cable_out = true);
        host.until_noted(&["no answer for 3 s"]);
        device.faults(|faults| faults.cable_out = false);
        host.until_noted(&["sampling", "session 2"]);
        assert_gap_free(&host.scans(4)[3..]);
    }
}

#[test]
fn a_step_of_the_clock_begins_a_new_segment_and_host_times_go_on() {
    // A step of less than 100 ms is told from a late packet once the clock is known, which takes 4 s.
    for (protocol, step_ms, scans) in [
        (Protocol::Sdk1, 5e6, 12),
        (Protocol::Sdk1, -700.0, 12),
        (Protocol::Sdk2, 90_000.0, 12),
        (Protocol::Sdk1, 40.0, 50),
        (Protocol::Sdk2, -15.0, 50),
    ] {
        let (device, mut host) = pair(protocol);
        host.scans(scans);
        device.faults(|faults| faults.clock_step_ms = step_ms);
        host.until_noted(&["sampling", "1 clock step"]);
        let scans = host.scans(10);
        let (header, points) = scans.last().unwrap();
        let off_ns = header.frame.start_ns - (device.began_ns().unwrap() + shot(&points[0]) as i64 * 10_000);
        assert!((-2_000_000..5_000_000).contains(&off_ns), "{off_ns} ns");
        let stamps: Vec<_> = host.output.scans.memory.iter().map(|(header, _)| header.frame.end_ns).collect();
        assert!(stamps.is_sorted());
    }
}

#[test]
fn every_source_of_time_gives_scans_and_a_change_of_source_is_a_new_segment() {
    let (device, mut host) = pair(Protocol::Sdk1);
    host.scans(2);
    for (changes, source) in [(1, TimeSource::Ptp), (2, TimeSource::Gps), (3, TimeSource::Pulse)] {
        device.set_time_source(source);
        host.until_noted(&["sampling", &format!("{changes} clock steps")]);
        let scans = host.scans(13);
        let (header, points) = scans.last().unwrap();
        assert_eq!((points.len(), header.lost_packets), (10_000, 0), "{source:?}");
        let off_ns = header.frame.start_ns - (device.began_ns().unwrap() + shot(&points[0]) as i64 * 10_000);
        assert!((-100_000..5_000_000).contains(&off_ns), "{source:?}: {off_ns} ns");
    }
}

#[test]
fn one_packet_lost_in_a_hundred_is_counted_to_the_packet_and_the_scans_go_on() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(3);
        device.faults(|faults| faults.lost_share = 0.01);
        host.scans(30);
        device.faults(|faults| faults.lost_share = 0.0);
        host.scans(2);
        let (swallowed, counts) = (device.sent().swallowed, host.lidar.counts());
        assert!(swallowed > 5, "{swallowed}");
        assert_eq!(counts.lost, swallowed, "{protocol:?}: {counts:?}");
        let in_scans: u64 =
            host.output.scans.memory.iter().map(|(header, _)| u64::from(header.lost_packets)).sum();
        assert_eq!(in_scans, swallowed);
        assert!(host.reporter.counters.degraded > 0);
        host.until_noted(&["sampling", &format!("{swallowed} lost")]);
    }
}

#[test]
fn packets_that_come_twice_or_late_or_damaged_are_left_out_and_counted() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(3);
        device.faults(|faults| {
            (faults.repeated_share, faults.late_share, faults.corrupt_share) = (0.02, 0.02, 0.02)
        });
        host.scans(30);
        device.faults(|faults| *faults = Faults::default());
        let scans = host.scans(4);
        assert_gap_free(&scans[3..]);
        let counts = host.lidar.counts();
        assert!(counts.late > 10 && counts.damaged > 5, "{protocol:?}: {counts:?}");
        // Each shot at most once, and in order.
        let shots: Vec<_> =
            host.output.scans.memory[3..].iter().flat_map(|(_, points)| points.iter().map(shot)).collect();
        assert!(shots.windows(2).all(|pair| pair[0] < pair[1]), "{protocol:?}");
        host.until_noted(&["late", "damaged"]);
    }
}

#[test]
fn a_stranger_s_packets_are_counted_and_nothing_of_them_is_used() {
    for protocol in BOTH {
        let (_device, mut host) = pair(protocol);
        let scans = host.scans(2);
        let genuine = scans[1].1.clone();
        assert!(!genuine.is_empty());
        let [_, stranger] = common::addresses();
        let socket = UdpSocket::bind((stranger, 0)).unwrap();
        let mut packet = Vec::new();
        match protocol {
            Protocol::Sdk1 => {
                let shots = [evac_formats_shot(); 100];
                evac_formats::livox_sdk1::encode_cartesian(1, &shots, &mut packet);
            }
            Protocol::Sdk2 => packet.resize(1380, 0),
        }
        let port = host.lidar.data_port().unwrap();
        for _ in 0..50 {
            socket.send_to(&packet, (host.config.interface, port)).unwrap();
        }
        let scans = host.scans(4);
        assert_gap_free(&scans[1..]);
        assert_eq!(host.lidar.counts().strangers, 50, "{protocol:?}");
        host.until_noted(&["sampling", "50 of strangers"]);
    }
}

fn evac_formats_shot() -> evac_formats::livox_sdk1::CartesianMm {
    evac_formats::livox_sdk1::CartesianMm { position: [9999, 0, 0], reflectivity: 1 }
}

#[test]
fn health_has_the_device_s_own_words_and_every_count() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(3);
        assert_eq!((host.reporter.device.status, host.reporter.device.sessions), (0, 1), "{protocol:?}");
        // Motor (bits 4 and 5): a warning; the scanner by the second protocol.
        device.faults(|faults| (faults.status, faults.lost_share, faults.corrupt_share) = (0x10, 0.02, 0.02));
        let complaint = if protocol == Protocol::Sdk1 { "motor warning" } else { "scanner warning" };
        host.until_noted(&["sampling", complaint]);
        host.scans(10);
        let (health, counts) = (host.reporter.device, host.lidar.counts());
        // Normal by the first protocol, sampling by the second.
        assert_eq!((health.status, health.state), (0x10, 1), "{protocol:?}");
        let kind = if protocol == Protocol::Sdk1 { DeviceKind::LivoxSdk1 } else { DeviceKind::LivoxSdk2 };
        assert_eq!(health.kind, kind as u32);
        let temperature = if protocol == Protocol::Sdk1 { NO_TEMPERATURE } else { 4150 };
        assert_eq!(health.temperature_centi, temperature);
        assert!(health.used > 500 && health.lost > 0 && health.corrupt > 0, "{protocol:?}: {health:?}");
        assert!(health.used <= counts.used && health.lost <= counts.lost, "{health:?} {counts:?}");
        // All is well again.
        device.faults(|faults| *faults = Faults::default());
        host.until("the complaint to end", |host| (!host.reporter.noted().contains(complaint)).then_some(()));
    }
}

#[test]
fn a_flood_of_garbage_on_every_port_leaves_the_session_and_the_scans_alone() {
    for protocol in BOTH {
        let (device, mut host) = pair(protocol);
        host.scans(2);
        let (interface, address) = (host.config.interface, host.config.device.unwrap());
        let search = if protocol == Protocol::Sdk1 { 55_000 } else { 56_000 };
        let ports = [host.lidar.data_port().unwrap(), host.lidar.command_port().unwrap(), search];
        let stop = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
        let flood = {
            let stop = std::sync::Arc::clone(&stop);
            // From the device's own address, so that it is not simply a stranger's.
            let socket = UdpSocket::bind((address, 0)).unwrap();
            std::thread::spawn(move || {
                let (mut sent, mut byte) = (0_u64, 0_u8);
                while !stop.load(std::sync::atomic::Ordering::Relaxed) {
                    let garbage: Vec<u8> =
                        (0..700).map(|n| byte.wrapping_mul(31).wrapping_add(n as u8)).collect();
                    byte = byte.wrapping_add(1);
                    for port in ports {
                        sent += u64::from(socket.send_to(&garbage, (interface, port)).is_ok());
                    }
                    std::thread::sleep(Duration::from_micros(500));
                }
                sent
            })
        };
        let scans = host.scans(15);
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        let sent = flood.join().unwrap();
        assert!(sent > 1000, "{sent}");
        let counts = host.lidar.counts();
        assert!(counts.damaged > sent / 2, "{protocol:?}: {sent} sent, {counts:?}");
        assert_gap_free(&scans[2..]);
        assert_eq!(device.sent().swallowed, 0);
        host.until_noted(&["sampling", "damaged"]);
    }
}

#[test]
fn an_interface_that_is_not_there_yet_is_waited_for_and_named() {
    // No computer has an address of the documentation's.
    let mut host = Host::new(Config { interface: "192.0.2.1".parse().unwrap(), ..Config::default() });
    host.until_noted(&["192.0.2.1:55000"]);
}
