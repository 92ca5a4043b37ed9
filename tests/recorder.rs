//! Recording and replay with real processes: what was recorded maps as the walk itself did, and other people's tools read it.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::{Bench, Running, wait_for};
use evac_formats::bag::{Bag, Messages};
use evac_formats::ros::{Encoding, octets};
use evac_frames::{Health, MapHeader, PoseFrame, Route, ScanHeader, route_flags};
use rustix::process::Signal;
use serde_json::Value;

const RIG: &str =
    "[rig.imu_from_lidar]\ntranslation_m = [0.05, -0.02, 0.06]\nroll_pitch_yaw_deg = [0.5, -1.0, 1.5]\n";
const RESULTS: [&str; 6] = ["trajectory.tum", "truth.tum", "map.ot", "map.bt", "plan.pgm", "cloud.pcd"];

/// A pipeline from the simulator to maps in `output`, with a recorder.
fn pipeline(bench: &Bench, mode: &str, output: &str, simulator: &str, recorder: &str) -> PathBuf {
    let domain = bench.domain.name();
    let mut text = format!("mode = \"{mode}\"\ndomain = \"{domain}\"\n{RIG}");
    text += &format!("[[stage]]\nkind = \"simulator\"\n[stage.config]\n{simulator}\n");
    for kind in ["deskewer", "lio", "octree_mapper"] {
        text += &format!("[[stage]]\nkind = \"{kind}\"\n");
    }
    for kind in ["grid_exporter", "map_saver"] {
        text += &format!("[[stage]]\nkind = \"{kind}\"\n[stage.config]\noutput_dir = \"{output}\"\n");
    }
    text += &format!("[[stage]]\nkind = \"recorder\"\n[stage.config]\n{recorder}\n");
    bench.write("recorded.toml", text)
}

fn up(bench: &Bench, pipeline: &Path) {
    bench.run([Path::new("up"), pipeline]).expect_success();
}

fn map(bench: &Bench, recording: &str, more: &[&str], output: &str) -> Value {
    bench.write("rig.toml", RIG);
    let args = ["map", recording, "--rig", "rig.toml", "-o", output];
    bench.run(args.iter().chain(more)).expect_success();
    serde_json::from_str(&bench.text(&format!("{output}/summary.json"))).unwrap()
}

#[track_caller]
fn assert_same(bench: &Bench, a: &str, b: &str) {
    for file in RESULTS {
        assert!(bench.bytes(&format!("{a}/{file}")) == bench.bytes(&format!("{b}/{file}")), "{file} differs");
    }
}

#[test]
fn a_recorded_walk_gives_the_same_poses_and_maps_byte_for_byte_from_one_file_or_several() {
    let bench = Bench::new();
    for (name, limits) in [
        ("one", ""),
        ("several", "max_file_s = 2.5"),
        ("raw", "ros = false"),
        ("packed", "ros = false\ncompression = \"lz4\""),
    ] {
        let recorder = format!("output_dir = \"rec\"\nname = \"{name}\"\n{limits}");
        up(&bench, &pipeline(&bench, "lossless", "walk", "duration_s = 8.0", &recorder));
        let summary = map(&bench, &format!("rec/{name}"), &[], name);
        assert_eq!((&summary["frames"], &summary["frames_lost"]), (&80.into(), &0.into()), "{name}");
        assert_same(&bench, "walk", name);
    }
    let files = |name: &str| std::fs::read_dir(bench.path(&format!("rec/{name}"))).unwrap().count();
    assert_eq!(files("one"), 1);
    assert_eq!(files("several"), 4);
    let size = |name: &str| std::fs::metadata(bench.path(&format!("rec/{name}/evac_0.mcap"))).unwrap().len();
    println!("raw frames: {} bytes plain, {} packed", size("raw"), size("packed"));
    assert!(size("packed") < size("raw"));
    assert_eq!(bench.leftovers(), Vec::<String>::new());
    let taken = bench.run(["up", "recorded.toml"]);
    taken.expect_error(4, &["packed", "there is a recording of that name"]);
}

#[test]
fn the_ros_messages_of_a_recording_alone_give_the_same_poses_and_maps() {
    let bench = Bench::new();
    let recorder = "output_dir = \"rec\"\nname = \"ros\"\nraw = false";
    up(&bench, &pipeline(&bench, "lossless", "walk", "duration_s = 8.0", recorder));
    let summary = map(&bench, "rec/ros", &[], "ros");
    assert_eq!((&summary["frames"], &summary["frames_lost"]), (&80.into(), &0.into()));
    // The true poses are not among what a replay takes from ROS messages.
    for file in RESULTS.iter().filter(|file| **file != "truth.tum") {
        assert!(
            bench.bytes(&format!("walk/{file}")) == bench.bytes(&format!("ros/{file}")),
            "{file} differs"
        );
    }
}

#[test]
fn a_recorder_that_is_killed_goes_on_beside_the_first_part_which_is_read_up_to_its_last_chunk() {
    let bench = Bench::new();
    let recorder = "output_dir = \"rec\"\nname = \"cut\"\nchunk_s = 0.5";
    let file = pipeline(&bench, "live", "walk", "duration_s = 300.0", recorder);
    let running = Running::start(bench.evac([Path::new("up"), &file]));
    let recording = bench.path("rec/cut/evac_0.mcap");
    let size = |path: &Path| std::fs::metadata(path).map_or(0, |file| file.len());
    wait_for("a few seconds to be on the disk", || (size(&recording) > 20_000_000).then_some(()));
    let recorder = wait_for("the recorder's pid", || status(&bench)?["stages"]["recorder"]["pid"].as_i64());
    let pid = rustix::process::Pid::from_raw(i32::try_from(recorder).unwrap()).unwrap();
    rustix::process::kill_process(pid, Signal::KILL).unwrap();
    let second = bench.path("rec/cut-1/evac_0.mcap");
    wait_for("the second part", || (size(&second) > 10_000_000).then_some(()));
    let incident = wait_for("the launcher's word", || {
        let incident = status(&bench)?["incidents"][0].clone();
        (!incident["resumed"].is_null()).then_some(incident)
    });
    running.signal(Signal::TERM);
    let ended = running.end().expect_success();
    let said = ended.stderr.lines().filter(|line| line.contains("the recording goes on in"));
    let said: Vec<_> = said.collect();
    assert!(matches!(said[..], [line] if line.contains("rec/cut-1")), "{said:?}");

    // The second part is whole, and begins with what the writers remember of the time of the first one.
    let frames = map(&bench, "rec/cut-1", &[], "second")["frames"].as_u64().unwrap();
    assert!(frames >= 10, "{frames} frames");
    let seqs = |part: &str, cut: bool| {
        let scans: Vec<ScanHeader> = headers_of(&bench.path(&format!("rec/{part}")), "/evac/lidar/scan", cut);
        scans.iter().map(|scan| scan.frame.seq).collect::<Vec<_>>()
    };
    let (first, second) = (seqs("cut", true), seqs("cut-1", false));
    for part in [&first, &second] {
        assert!(part.windows(2).all(|pair| pair[1] == pair[0] + 1), "{part:?}");
    }
    let ends = (*first.last().unwrap(), second[0]);
    println!("first part up to scan {}, second from {}; {}", ends.0, ends.1, incident["resumed"]);
    // Sixteen scans are remembered; what the killed one had not handed to the disk is half a second at most.
    if incident["resumed"]["after_ms"].as_f64().unwrap() < 800.0 {
        assert!(ends.1 <= ends.0 + 1, "{ends:?}: scans are in neither part");
    }

    let refused = bench.run(["map", "rec/cut", "-o", "refused"]);
    refused.expect_error(4, &["evac_0.mcap", "byte ", "--allow-truncated", "mcap recover"]);
    let whole = map(&bench, "rec/cut", &["--allow-truncated"], "killed")["frames"].as_u64().unwrap();
    assert!(whole >= 10, "{whole} frames");

    // A power cut may end the file anywhere: half a second at most is lost against the whole file.
    let bytes = std::fs::read(&recording).unwrap();
    for cut in [1, 1000, 100_000] {
        std::fs::create_dir_all(bench.path("cut")).unwrap();
        bench.write("cut/evac_0.mcap", &bytes[..bytes.len() - cut]);
        let frames = map(&bench, "cut", &["--allow-truncated"], "shorter")["frames"].as_u64().unwrap();
        assert!(
            (whole.saturating_sub(7)..=whole).contains(&frames),
            "{frames} of {whole} frames, cut by {cut}"
        );
    }
}

/// The words of a stage's report.
fn note(bench: &Bench, stage: &str) -> Option<String> {
    Some(status(bench)?["stages"][stage]["reason"].as_str()?.to_owned())
}

/// `evac up FILE` where `rec` is a disk of so many MiB of its own, of which `saved` is a copy at the end. `None` with a printed line
/// where no disk can be mounted.
fn up_with_small_disk(bench: &Bench, file: &Path, mib: u32) -> Option<Running> {
    std::fs::create_dir(bench.path("rec")).unwrap();
    let mount = format!("mount -t tmpfs -o size={mib}m none rec");
    let mounted = |script: &str| {
        let mut command = Command::new("unshare");
        command.args(["-Urm", "sh", "-c", &format!("{mount} && {script}")]).current_dir(bench.path(""));
        command
    };
    if !mounted("true").output().is_ok_and(|output| output.status.success()) {
        println!("skipped: no disk can be mounted here (unshare -Urm)");
        return None;
    }
    let evac = env!("CARGO_BIN_EXE_evac");
    // The shell hands the signal on, and waits again where it interrupts the waiting.
    let script = format!(
        "{evac} up {} & evac=$!; trap 'kill -TERM $evac' TERM; wait $evac; code=$?; \
         while kill -0 $evac 2>/dev/null; do wait $evac; code=$?; done; cp -r rec saved; exit $code",
        file.display()
    );
    Some(Running::start(mounted(&script)))
}

#[test]
fn a_full_disk_ends_the_recording_and_nothing_else_and_what_was_recorded_is_whole() {
    let bench = Bench::new();
    let recorder = "output_dir = \"rec\"\nname = \"full\"\nmax_file_s = 1.0\nchunk_s = 0.3";
    let file = pipeline(&bench, "live", "walk", "duration_s = 300.0", recorder);
    let Some(running) = up_with_small_disk(&bench, &file, 40) else { return };
    wait_for("the disk to be full", || {
        note(&bench, "recorder")?.contains("recording has stopped: No space left").then_some(())
    });
    let mapped = || frames_out(&bench, "map_saver");
    let before = wait_for("a count", mapped);
    wait_for("the walk to go on", || (mapped()? > before + 10).then_some(()));
    running.signal(Signal::TERM);
    let ended = running.end();
    // The code says that something is missing, the words what and what to do.
    assert_eq!(ended.code, 4, "{}", ended.stderr);
    for words in [
        "nothing more is recorded, the pipeline goes on",
        "No space left",
        "free some disk space",
        "MB are kept",
    ] {
        assert!(ended.stderr.contains(words), "no '{words}' in {}", ended.stderr);
    }
    assert!(
        bench.text("walk/trajectory.tum").lines().count() as u64 > before,
        "the map is of the whole walk"
    );

    // All files are there, and each is whole: none was removed to make room.
    let mut files: Vec<_> =
        std::fs::read_dir(bench.path("saved/full")).unwrap().map(|file| file.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 2, "{files:?}");
    let names: Vec<_> = files.iter().map(|file| file.file_name().unwrap().to_str().unwrap()).collect();
    let all: Vec<_> = (0..files.len()).map(|number| format!("evac_{number}.mcap")).collect();
    assert_eq!(names, all);
    let frames = map(&bench, "saved/full", &[], "again")["frames"].as_u64().unwrap();
    assert!(frames >= 10, "{frames} frames");
    let Some(read) = evac_testkit::ros_libraries(&["read".as_ref(), &files[0]]) else { return };
    let found: Value = serde_json::from_str(&read.unwrap()).unwrap();
    assert_eq!(found["mcap"], found["rosbags"]);
    // Those that were open have no index, as there was no room for it: `rosbags` wants one, `mcap` does not.
    for file in &files {
        evac_testkit::ros_libraries(&["stream".as_ref(), file]).unwrap().unwrap();
    }
}

#[test]
fn other_peoples_libraries_read_every_message_of_a_recording_and_what_is_left_of_one_that_was_cut() {
    read_by_others("none");
}

#[test]
fn other_peoples_libraries_read_a_recording_that_is_packed_with_lz4() {
    read_by_others("lz4");
}

fn read_by_others(compression: &str) {
    let bench = Bench::new();
    let recorder = format!("output_dir = \"rec\"\nname = \"walk\"\ncompression = \"{compression}\"");
    up(&bench, &pipeline(&bench, "lossless", "walk", "duration_s = 4.0", &recorder));
    let file = bench.path("rec/walk/evac_0.mcap");
    let Some(read) = evac_testkit::ros_libraries(&["read".as_ref(), &file]) else { return };
    let found: Value = serde_json::from_str(&read.unwrap()).unwrap();
    assert_eq!(found["profile"], "ros2");
    for (topic, kind, count) in [
        ("/lidar/scan", "sensor_msgs/msg/PointCloud2", 40),
        ("/scan/deskewed", "sensor_msgs/msg/PointCloud2", 40),
        ("/imu/sample", "sensor_msgs/msg/Imu", 801),
        ("/odometry/pose", "nav_msgs/msg/Odometry", 40),
        ("/tf", "tf2_msgs/msg/TFMessage", 40),
        ("/truth/pose", "geometry_msgs/msg/PoseStamped", 40),
        ("/map/update", "sensor_msgs/msg/PointCloud2", 40),
        ("/evac/lidar/scan", "std_msgs/msg/UInt8MultiArray", 40),
    ] {
        for library in ["mcap", "rosbags"] {
            assert_eq!(found[library][format!("{topic} {kind}")], count, "{library} {topic}");
        }
    }
    // The word that no later one comes may be the last sample itself, or a copy of it.
    let raw = found["mcap"]["/evac/imu/sample std_msgs/msg/UInt8MultiArray"].as_u64().unwrap();
    assert!((801..=802).contains(&raw), "{raw}");
    for topic in ["/grid/plan nav_msgs/msg/OccupancyGrid", "/diagnostics diagnostic_msgs/msg/DiagnosticArray"]
    {
        assert!(found["mcap"][topic].as_u64() > Some(0), "{topic}");
    }
    assert_eq!(found["scan"], serde_json::json!([10_000, 20, ["x", "y", "z", "intensity", "t"]]));
    assert_eq!((&found["pose"][0], &found["pose"][1]), (&"map".into(), &"lidar".into()));
    // The last pose is that of the trajectory file, to its digits.
    let trajectory = bench.text("walk/trajectory.tum");
    let last: Vec<f64> = trajectory.lines().last().unwrap().split(' ').map(|v| v.parse().unwrap()).collect();
    for (axis, value) in last[1..4].iter().enumerate() {
        assert!((found["position"][axis].as_f64().unwrap() - value).abs() < 1e-8, "{found}");
    }
    assert!(found["pose"][2][0].as_f64() > Some(0.0), "no covariance");
    assert_eq!(found["grid"][2], found["grid"][0].as_u64().unwrap() * found["grid"][1].as_u64().unwrap());
    assert!(found["attachments"]["pipeline.toml"].as_str().unwrap().contains("kind = \"recorder\""));
    assert!(found["attachments"]["rig.toml"].as_str().unwrap().contains("translation_m"));

    let bytes = std::fs::read(&file).unwrap();
    let cut = bench.write("cut.mcap", &bytes[..bytes.len() / 2]);
    let salvaged = evac_testkit::ros_libraries(&["salvage".as_ref(), &cut]).unwrap().unwrap();
    let (salvaged, all): (u64, u64) = (
        salvaged.trim().parse().unwrap(),
        found["mcap"].as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum(),
    );
    assert!((all / 4..all).contains(&salvaged), "{salvaged} of {all} messages");
}

fn status(bench: &Bench) -> Option<Value> {
    let ended = bench.run(["status", "--domain", bench.domain.name(), "--json"]);
    serde_json::from_str(&ended.stdout).ok()
}

fn frames_out(bench: &Bench, stage: &str) -> Option<u64> {
    status(bench)?["stages"][stage]["frames"]["out"].as_u64()
}

/// Frames up to the newest that a stage is done with, whichever instance was.
fn done(bench: &Bench, stage: &str) -> Option<u64> {
    Some(status(bench)?["stages"][stage]["last_seq"].as_u64()? + 1)
}

/// The headers of a recording's raw frames on a topic.
fn headers<T: bytemuck::Pod>(recording: &Path, topic: &str) -> Vec<T> {
    headers_of(recording, topic, false)
}

/// As [`headers`], of a file whose end may be missing.
fn headers_of<T: bytemuck::Pod>(recording: &Path, topic: &str, is_cut: bool) -> Vec<T> {
    let bag = Bag::open(recording, is_cut).unwrap();
    let connection = bag.connections().iter().find(|connection| connection.topic == topic).unwrap();
    let (mut messages, mut found) = (Messages::new(&bag, &[connection.id]), Vec::new());
    while let Some(message) = messages.next_message().unwrap() {
        let bytes = octets(message.data, Encoding::Cdr).unwrap();
        found.push(bytemuck::pod_read_unaligned(&bytes[..size_of::<T>()]));
    }
    found
}

#[test]
fn a_recording_with_swaps_and_a_kill_in_it_holds_each_frame_once_from_the_instance_that_consumers_took_it_of()
{
    let bench = Bench::new();
    let file = pipeline(&bench, "live", "walk", "seed = 3", "output_dir = \"rec\"\nname = \"swaps\"");
    let running = Running::start(bench.evac([Path::new("up"), &file]));
    wait_for("the walk", || (frames_out(&bench, "map_saver")? > 40).then_some(()));
    let domain = ["--domain", bench.domain.name()];
    bench.run([["swap", "lio", "--kind", "loam"].as_slice(), &domain].concat()).expect_success();
    bench.run([["standby", "deskewer"].as_slice(), &domain].concat()).expect_success();
    let leader = wait_for("the deskewer", || status(&bench)?["stages"]["deskewer"]["pid"].as_i64());
    let pid = rustix::process::Pid::from_raw(i32::try_from(leader).unwrap()).unwrap();
    rustix::process::kill_process(pid, Signal::KILL).unwrap();
    let at = wait_for("the walk to go on", || {
        let status = status(&bench)?;
        (status["stages"]["deskewer"]["epoch"] == 1).then(|| frames_out(&bench, "map_saver")).flatten()
    });
    wait_for("the walk to go on", || (frames_out(&bench, "map_saver")? > at + 10).then_some(()));
    running.signal(Signal::TERM);
    running.end().expect_success();

    let recording = bench.path("rec/swaps");
    let poses: Vec<PoseFrame> = headers(&recording, "/evac/odometry/pose");
    let scans: Vec<ScanHeader> = headers(&recording, "/evac/scan/deskewed");
    let updates: Vec<MapHeader> = headers(&recording, "/evac/map/update");
    for frames in [
        poses.iter().map(|pose| pose.frame).collect::<Vec<_>>(),
        scans.iter().map(|scan| scan.frame).collect(),
        updates.iter().map(|update| update.frame).collect(),
    ] {
        assert!(frames.windows(2).all(|pair| pair[0].seq < pair[1].seq && pair[0].epoch <= pair[1].epoch));
    }
    // The route says where: each frame is of the instance that it names for it.
    let routes: Vec<Route> = headers(&recording, "/evac/route");
    for (service, frames) in [
        ("odometry/pose", poses.iter().map(|pose| pose.frame).collect::<Vec<_>>()),
        ("scan/deskewed", scans.iter().map(|scan| scan.frame).collect()),
    ] {
        let asks = |route: &&Route| route.flags & route_flags::HAND_OVER == 0;
        let cut =
            routes.iter().filter(asks).rfind(|route| Health::text_of(&route.service) == service).unwrap();
        assert_eq!(cut.epoch, 1, "{routes:?}");
        assert!(frames.iter().any(|frame| frame.epoch == 0) && frames.iter().any(|frame| frame.epoch == 1));
        // Who was killed may have got further than was known; either copy will do.
        let alone = cut.flags & route_flags::ALONE != 0;
        for frame in frames {
            let from = u32::from(frame.seq >= cut.from_seq);
            assert!(frame.epoch == from || alone, "{service}: {frame:?}, {cut:?}");
        }
    }
    // The map saver took the same poses, as far as it got each with its scan and update.
    let trajectory = bench.text("walk/trajectory.tum");
    let taken: Vec<Vec<f64>> = trajectory
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.split(' ').map(|value| value.parse().unwrap()).collect())
        .collect();
    assert!(taken.len() > 50, "{}", taken.len());
    for row in taken {
        let pose = poses.iter().find(|pose| (pose.frame.end_ns as f64 * 1e-9 - row[0]).abs() < 1e-6);
        let pose = pose.unwrap_or_else(|| panic!("no pose at {} s", row[0]));
        assert!((0..3).all(|axis| (pose.position[axis] - row[axis + 1]).abs() < 1e-8), "{pose:?} {row:?}");
    }
}

#[test]
fn a_lossless_recording_with_swaps_in_it_maps_byte_for_byte_as_the_consumers_did() {
    let bench = Bench::new();
    let recorder = "output_dir = \"rec\"\nname = \"swaps\"";
    let file = pipeline(&bench, "lossless", "walk", "duration_s = 300.0", recorder);
    // Scan by scan: a fast machine is not through before the swaps are, and a slow one not held up.
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, format!("step = true\n{text}")).unwrap();
    let (running, mut lines) = Running::start_with_input(bench.evac([Path::new("up"), &file]));
    let mut gone = 0;
    let mut step = |scans: u64| {
        lines.write_all(format!("{scans}\n").as_bytes()).unwrap();
        gone += scans;
        wait_for("the scans to be mapped", || (done(&bench, "map_saver")? >= gone).then_some(()));
        gone
    };
    step(25);
    for stage in ["octree_mapper", "map_saver", "grid_exporter"] {
        let mut swap = Running::start(bench.evac(["swap", stage, "--domain", bench.domain.name()]));
        while swap.is_running() {
            step(2);
        }
        swap.end().expect_success();
    }
    let gone = step(5);
    wait_for("all sinks", || {
        let sinks = ["grid_exporter", "map_saver", "simulator"].map(|stage| done(&bench, stage));
        (sinks == [Some(gone); 3]).then_some(())
    });
    running.signal(Signal::TERM);
    running.end().expect_success();
    let summary = map(&bench, "rec/swaps", &[], "again");
    assert_eq!((&summary["frames"], &summary["frames_lost"]), (&gone.into(), &0.into()));
    assert_same(&bench, "walk", "again");
}
