//! One stage as a process of its own, without a launcher: it sleeps while nothing comes, and signals reach it.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::time::{Duration, Instant};

use common::{Bench, Running, WATCHDOG, wait_for};
use evac_formats::livox_sdk1::{CartesianMm, DATAGRAM_SHOTS, encode_cartesian};
use evac_formats::pcap::PcapWriter;
use evac_formats::wt901c::{encode_accel, encode_gyro};
use evac_frames::{
    FrameHeader, Health, ImuSample, MapHeader, Point, PoseFrame, ScanHeader, StageState, TrackingState,
    Voxel, frame_flags, map_flags,
};
use evac_ports::services::{
    HealthStatus, Imu, LidarScan, MapSnapshot, MapUpdate, OdometryPose, ScanDeskewed,
};
use evac_ports::{Bus, DomainLock, FramePublisher, RecordPublisher, RecordSubscriber};
use rustix::process::Signal;

/// The launcher's place, and what producers would publish.
struct Line {
    bench: Bench,
    health: RecordSubscriber<HealthStatus>,
    scans: FramePublisher<LidarScan>,
    imu: RecordPublisher<Imu>,
    bus: Bus,
    _lock: DomainLock,
}

impl Line {
    fn new() -> Self {
        let bench = Bench::new();
        let lock = bench.domain.lock().unwrap();
        let bus = Bus::join(&bench.domain, "test").unwrap();
        let (health, _listener) = RecordSubscriber::open(&bus).unwrap();
        let (scans, imu) = (FramePublisher::open(&bus).unwrap(), RecordPublisher::open(&bus).unwrap());
        Self { bench, health, scans, imu, bus, _lock: lock }
    }

    /// Starts a stage and waits until it is ready.
    fn start(&self, kind: &str) -> Running {
        self.start_with(kind, &[])
    }

    fn start_with(&self, kind: &str, more: &[&str]) -> Running {
        let arguments = ["stage", kind, "--domain", self.bench.domain.name()];
        let mut stage = Running::start(self.bench.evac(arguments.iter().chain(more)));
        self.report_of(&mut stage, |_| true);
        stage
    }

    /// Waits for a report that is as it should be.
    #[track_caller]
    fn report_of(&self, stage: &mut Running, is_it: impl Fn(&Health) -> bool) -> Health {
        wait_for("a report", || {
            assert!(stage.is_running(), "the stage has ended");
            std::iter::from_fn(|| self.health.receive().unwrap())
                .find(|health| i64::from(health.pid) == i64::from(stage.pid()) && is_it(health))
        })
    }

    fn scan(&self, seq: u64, points: usize) {
        let end_ns = (seq as i64 + 1) * 100_000_000;
        let frame = FrameHeader { seq, start_ns: end_ns - 100_000_000, end_ns, ..FrameHeader::default() };
        let header = ScanHeader { frame, points: points as u32, ..ScanHeader::default() };
        self.scans.publish(points, |_| Point::new(2.0, 0.0, 0.0, 0, 0), || header).unwrap();
    }

    /// Says that no IMU sample will come, so that scans wait for none.
    fn end_imu(&self) {
        self.imu.publish(&ImuSample { flags: frame_flags::END_OF_STREAM, ..ImuSample::default() }).unwrap();
    }
}

/// CPU time of a process so far, user and system, seconds.
fn cpu_s(stage: &Running) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", stage.pid())).unwrap();
    // After the name, which may hold spaces: fields 14 and 15 of all, in ticks of 10 ms.
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

#[test]
fn stages_without_a_producer_sleep() {
    let line = Line::new();
    let kinds = ["deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"];
    let stages = kinds.map(|kind| line.start(kind));
    let before = stages.each_ref().map(cpu_s);
    std::thread::sleep(Duration::from_secs(3));
    for ((stage, before), kind) in stages.iter().zip(before).zip(kinds) {
        let used = cpu_s(stage) - before;
        assert!(used < 0.5, "{kind} used {used} s of 3 s");
    }
}

#[test]
fn a_stage_that_has_had_frames_sleeps_again() {
    let line = Line::new();
    let mut stage = line.start("deskewer");
    // One that is handed on, and one that waits for an IMU that does not come until its patience ends.
    line.scan(0, 100);
    line.report_of(&mut stage, |health| health.frames_out == 1 && health.late == 1);
    let before = cpu_s(&stage);
    std::thread::sleep(Duration::from_secs(3));
    let used = cpu_s(&stage) - before;
    assert!(used < 0.5, "{used} s of 3 s");
}

#[test]
fn a_stage_that_was_stopped_and_continued_goes_on_and_sigterm_ends_it() {
    let line = Line::new();
    let mut stage = line.start("deskewer");
    line.end_imu();
    for seq in 0..3 {
        stage.signal(Signal::STOP);
        wait_for("the stage to stop", || {
            let status = std::fs::read_to_string(format!("/proc/{}/status", stage.pid())).unwrap();
            status.contains("State:\tT").then_some(())
        });
        stage.signal(Signal::CONT);
        line.scan(seq, 10);
        line.report_of(&mut stage, |health| health.frames_out == seq + 1);
        assert!(stage.is_running());
    }
    stage.signal(Signal::TERM);
    stage.end().expect_success();
}

#[test]
fn a_stage_that_is_slower_than_its_input_ends_on_sigterm_all_the_same() {
    let line = Line::new();
    let mut stage = line.start("octree_mapper");
    let scans = FramePublisher::<ScanDeskewed>::open(&line.bus).unwrap();
    let poses = RecordPublisher::<OdometryPose>::open(&line.bus).unwrap();
    // Every scan is a key frame of a wall 20 m away: much quicker written than mapped.
    let send = |seq: u64| {
        let frame = FrameHeader { seq, end_ns: seq as i64 * 100_000_000, ..FrameHeader::default() };
        let header = ScanHeader { frame, points: 5000, ..ScanHeader::default() };
        let wall =
            |i: usize| Point::new(20.0, 0.1 * (i % 100) as f32 - 5.0, 0.1 * (i / 100) as f32 - 2.5, 0, 0);
        scans.publish(5000, wall, || header).unwrap();
        let (position, orientation) = ([0.0, seq as f64 % 7.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
        let state = TrackingState::Tracking as u32;
        poses.publish(&PoseFrame { frame, position, orientation, state, ..PoseFrame::default() }).unwrap();
    };
    // From here on there is no pause in which the stage could catch up.
    let (started, mut seq, mut told) = (Instant::now(), 0, false);
    while stage.is_running() {
        assert!(started.elapsed() < WATCHDOG, "the watchdog ended the wait for the stage to end");
        send(seq);
        seq += 1;
        // Some frames for each that is mapped, so that there is always a next one, whole.
        std::thread::sleep(Duration::from_millis(2));
        let overrun = std::iter::from_fn(|| line.health.receive().unwrap()).any(|health| health.lost > 0);
        if overrun && !told {
            stage.signal(Signal::TERM);
            told = true;
        }
    }
    assert!(told, "it ended of itself");
    stage.end().expect_success();
}

#[test]
fn a_sink_that_has_to_wait_for_the_map_says_so_until_it_has_it() {
    let line = Line::new();
    let updates = FramePublisher::<MapUpdate>::open(&line.bus).unwrap();
    let snapshots = FramePublisher::<MapSnapshot>::open(&line.bus).unwrap();
    let poses = RecordPublisher::<OdometryPose>::open(&line.bus).unwrap();
    let output = line.bench.path("plan");
    let text = format!(
        "mode = \"live\"\n[[stage]]\nkind = \"grid_exporter\"\n[stage.config]\noutput_dir = \"{}\"\n",
        output.display()
    );
    let file = line.bench.write("exporter.toml", text);
    let mut exporter = line.start_with("grid_exporter", &["--config", file.to_str().unwrap()]);
    let header = |seq: u64, key_frames: u64, flags: u32| MapHeader {
        frame: FrameHeader { seq, end_ns: seq as i64 * 100_000_000, ..FrameHeader::default() },
        resolution: 0.2,
        map_flags: flags,
        key_frames,
        voxels: 1,
        ..MapHeader::default()
    };
    let voxel = |_: usize| Voxel { key: [32_768; 3], log_odds: 0.85, ..Voxel::default() };
    let send = |seq: u64, key_frames: u64| {
        let header = header(seq, key_frames, map_flags::KEY_FRAME);
        poses.publish(&PoseFrame { frame: header.frame, ..PoseFrame::default() }).unwrap();
        updates.publish(1, voxel, || header).unwrap();
    };
    let (running, waiting) = (StageState::Running as u32, StageState::Waiting as u32);
    send(0, 1);
    line.report_of(&mut exporter, |health| health.state == running && health.frames_out == 1);
    // Three key frames have not come to it.
    send(1, 5);
    send(2, 6);
    let waits = line.report_of(&mut exporter, |health| health.state == waiting);
    line.report_of(&mut exporter, |health| {
        health.state == waiting && health.reported_ns > waits.reported_ns && health.frames_out == 1
    });
    snapshots.publish(1, voxel, || header(2, 6, map_flags::SNAPSHOT)).unwrap();
    send(3, 7);
    line.report_of(&mut exporter, |health| health.state == running && health.last_seq == 3);
    exporter.signal(Signal::TERM);
    exporter.end().expect_success();
}

#[test]
fn a_replay_reports_scans_with_lost_packets_as_degraded_and_goes_on_reporting_after_its_end() {
    let line = Line::new();
    // Five scans; the second and the fourth miss packets, and three datagrams are no Livox data.
    let (mut writer, mut payload) = (PcapWriter::new(Vec::new()).unwrap(), Vec::new());
    let (lidar, host) = ("192.168.1.11:65000".parse().unwrap(), "192.168.1.50:60001".parse().unwrap());
    let shots = [CartesianMm { position: [2000, 0, 0], reflectivity: 9 }; DATAGRAM_SHOTS];
    for ms in (0..500_u64).filter(|ms| ![150, 151, 333].contains(ms)) {
        encode_cartesian(ms * 1_000_000, &shots, &mut payload);
        writer.write_udp(ms as i64 * 1_000_000, lidar, host, &payload).unwrap();
        if ms < 3 {
            writer.write_udp(ms as i64 * 1_000_000, lidar, host, b"hello").unwrap();
        }
    }
    let capture = line.bench.write("lidar.pcap", writer.finish().unwrap());
    let sample = [encode_accel([0, 0, 2048], 2500), encode_gyro([0, 0, 0], 500)].concat();
    let log = line.bench.write("wt901c.bin", sample.repeat(100));
    let config = format!(
        "mode = \"live\"\n[[stage]]\nkind = \"replay\"\n[stage.config]\nlidar = \"{}\"\nimu = \"{}\"\n",
        capture.display(),
        log.display()
    );
    let file = line.bench.write("replay.toml", config);
    let mut replay = line.start_with("replay", &["--config", file.to_str().unwrap()]);
    let ended = line.report_of(&mut replay, |health| health.state == StageState::Finished as u32);
    assert_eq!((ended.frames_out, ended.total), (5, 5));
    assert_eq!((ended.degraded, ended.rejected, ended.late, ended.lost), (2, 3, 0, 0));
    // For whoever asks for the status only now.
    line.report_of(&mut replay, |health| health.reported_ns > ended.reported_ns);
    replay.signal(Signal::TERM);
    replay.end().expect_success();
}

#[test]
fn a_stage_whose_launcher_has_gone_before_it_began_does_not_start() {
    let line = Line::new();
    let domain = line.bench.domain.name();
    let stage = |parent: &str| {
        line.bench.evac(["stage", "deskewer", "--domain", domain, "--die-with-parent", parent])
    };
    // Process 2 is a kernel thread, or not there at all.
    Running::start(stage("2")).end().expect_error(5, &["launcher has ended"]);
    let mut mine = Running::start(stage(&std::process::id().to_string()));
    line.report_of(&mut mine, |_| true);
    mine.signal(Signal::TERM);
    mine.end().expect_success();
}
