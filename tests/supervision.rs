//! Stages are stopped and killed without a standby: what the launcher notices, says and mends.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;
#[path = "common/observer.rs"]
mod observer;
#[path = "common/pids.rs"]
mod pids;
#[path = "common/walk.rs"]
mod walk;

use common::{Bench, Running, wait_for};
use observer::Observer;
use pids::Pids;
use rustix::process::{Pid, Signal, getpid, kill_process, set_child_subreaper};
use serde_json::Value;
use walk::{STAGES, pipeline, status, wait_for_frames};

fn signal(pid: &Value, signal: Signal) {
    let pid = i32::try_from(pid.as_i64().unwrap()).unwrap();
    kill_process(Pid::from_raw(pid).unwrap(), signal).unwrap();
}

/// Waits until a new instance of the stage has put out frames, and gives what the launcher said of the old one's end.
fn wait_for_another(bench: &Bench, stage: &str, before: &Value) -> Value {
    wait_for("a new instance with frames", || {
        let status = status(bench)?;
        let led = &status["stages"][stage];
        let is_new =
            led["epoch"].as_u64() > before["epoch"].as_u64() && led["frames"]["out"].as_u64() > Some(3);
        let incident =
            status["incidents"].as_array()?.iter().rev().find(|incident| incident["stage"] == stage)?;
        (is_new && !incident["resumed"].is_null()).then(|| incident.clone())
    })
}

#[test]
fn a_stage_that_hangs_is_started_again_and_status_and_log_say_why() {
    let bench = Bench::new();
    let file = pipeline(&bench, "[supervision]\nhang_after_frames = 20", "live", "seed = 3");
    let up = Running::start(bench.evac(["up", &file]));
    for stage in ["lio", "deskewer", "octree_mapper", "map_saver"] {
        let before = wait_for_frames(&bench, 10)["stages"][stage].clone();
        signal(&before["pid"], Signal::STOP);
        let incident = wait_for_another(&bench, stage, &before);
        let cause = incident["cause"].as_str().unwrap();
        assert!(
            cause.contains(stage) && cause.contains("hangs") && cause.contains("its last frame is"),
            "{cause}"
        );
        let table = bench.run(["status", "--domain", bench.domain.name()]).expect_success().stdout;
        assert!(table.contains(cause) && table.contains("started again"), "{table}");
        println!("{stage}: {cause}; {}", incident["resumed"]);
    }
    up.signal(Signal::TERM);
    let ended = up.end().expect_success();
    assert_eq!(ended.stderr.matches("hangs: ").count(), 4, "{}", ended.stderr);
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_producer_that_hangs_is_started_again_and_no_frame_is_missing() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 3");
    let up = Running::start(bench.evac(["up", &file]));
    let before = wait_for_frames(&bench, 10)["stages"]["simulator"].clone();
    let observer = Observer::start(&bench.domain);
    signal(&before["pid"], Signal::STOP);
    let incident = wait_for_another(&bench, "simulator", &before);
    let cause = incident["cause"].as_str().unwrap();
    assert!(cause.contains("'simulator' hangs: it has not reported for"), "{cause}");
    wait_for_frames(&bench, 5);
    let mut heard = observer.stop();
    // What reached some readers only is said once more.
    heard.poses.dedup_by_key(|pose| pose.frame.seq);
    observer::assert_gap_free("odometry/pose", heard.poses.iter().map(|pose| pose.frame.seq));
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

/// Kills one instance of `stage` when frame `seq` has come to a sink.
fn kill_at(bench: &Bench, stage: &str, seq: u64) {
    let health = Pids::of(&bench.domain).at(stage, seq);
    kill_process(Pid::from_raw(i32::try_from(health.pid).unwrap()).unwrap(), Signal::KILL).unwrap();
}

#[test]
fn the_files_after_a_kill_in_a_lossless_walk_are_those_of_a_walk_without() {
    const FILES: [&str; 5] = ["map.ot", "map.bt", "trajectory.tum", "cloud.pcd", "plan.pgm"];
    let walk = "seed = 6\nduration_s = 60.0";
    let whole = Bench::new();
    let file = pipeline(&whole, "mode = \"lossless\"", "out", walk);
    Running::start(whole.evac(["up", &file])).end().expect_success();
    // Frames that are no round numbers, early and late in the walk.
    for (stage, seq) in [
        ("deskewer", 97),
        ("octree_mapper", 37),
        ("octree_mapper", 211),
        ("map_saver", 113),
        ("grid_exporter", 167),
        ("simulator", 59),
    ] {
        let bench = Bench::new();
        let file = pipeline(&bench, "mode = \"lossless\"", "out", walk);
        let up = Running::start(bench.evac(["up", &file]));
        kill_at(&bench, stage, seq);
        let ended = up.end().expect_success();
        let said = ended.stderr.lines().find(|line| line.contains("started again, next frame"));
        println!("{stage} killed at {seq}: {}", said.unwrap_or(&ended.stderr));
        for file in FILES {
            let [a, b] = [&whole, &bench].map(|bench| bench.bytes(&format!("out/{file}")));
            assert!(a == b, "{stage} killed at {seq}: {file} differs\n{}", ended.stderr);
        }
        assert_eq!(bench.leftovers(), Vec::<String>::new());
    }
}

#[test]
fn each_stage_that_is_killed_goes_on_by_itself_and_which_frames_it_cost_is_said() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 4");
    let up = Running::start(bench.evac(["up", &file]));
    wait_for_frames(&bench, 40);
    let observer = Observer::start(&bench.domain);
    for stage in ["deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver", "simulator"] {
        let before = wait_for_frames(&bench, 5)["stages"][stage].clone();
        signal(&before["pid"], Signal::KILL);
        let incident = wait_for_another(&bench, stage, &before);
        let resumed = &incident["resumed"];
        println!(
            "{stage}: killed after frame {}, frame {} after {} ms",
            incident["last_seq"], resumed["seq"], resumed["after_ms"]
        );
        assert!(incident["cause"].as_str().unwrap().contains("signal 9"), "{incident}");
    }
    let status = wait_for_frames(&bench, 5);
    let heard = observer.stop();
    println!("longest gap of the pose stream: {:.0} ms", heard.longest_gap_s() * 1e3);
    for (seq, way, turn) in heard.jumps() {
        println!("frame {seq}: {:.1} mm, {:.3} degrees off at the cut", way * 1e3, turn.to_degrees());
        // The same map frame: another one would be off by metres.
        assert!(way < 0.3 && turn < 0.05, "frame {seq}: {way} m, {turn} rad");
    }
    // What a stage does not have, it says frame by frame.
    for stage in &STAGES[1..] {
        let stage = &status["stages"][stage];
        assert!(
            stage["frames"]["lost"] == 0 || stage["reason"].as_str().unwrap().contains("missing frames"),
            "{stage}"
        );
    }
    up.signal(Signal::TERM);
    up.end().expect_success();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn an_odometry_that_is_started_again_twice_misses_nothing_from_before_its_death() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 8\nlaps = 3");
    let up = Running::start(bench.evac(["up", &file]));
    for _ in 0..2 {
        // More than there is in the history.
        let before = wait_for_frames(&bench, 25)["stages"]["lio"].clone();
        signal(&before["pid"], Signal::KILL);
        let incident = wait_for_another(&bench, "lio", &before);
        let reason = wait_for_frames(&bench, 5)["stages"]["lio"]["reason"].as_str().unwrap().to_owned();
        let named = reason.strip_prefix("missing frames: ").unwrap_or_default();
        let named = named.split(|c: char| !c.is_ascii_digit()).filter_map(|seq| seq.parse().ok());
        for seq in named {
            let last = incident["last_seq"].as_u64();
            assert!(Some::<u64>(seq) >= last, "{reason}; {incident}");
        }
    }
    up.signal(Signal::TERM);
    up.end().expect_success();
}

#[test]
fn a_producer_is_swapped_and_the_gap_is_stated() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 5");
    let up = Running::start(bench.evac(["up", &file]));
    let before = wait_for_frames(&bench, 10);
    let observer = Observer::start(&bench.domain);
    let ended = bench.run(["swap", "simulator", "--json", "--domain", bench.domain.name()]).expect_success();
    assert!(
        ended.stderr.contains("nothing came for") && ended.stderr.contains("no frame is missing"),
        "{}",
        ended.stderr
    );
    let outcome: Value = serde_json::from_str(&ended.stdout).unwrap();
    let after = wait_for_frames(&bench, before["stages"]["lio"]["frames"]["out"].as_u64().unwrap() + 20);
    assert_eq!(after["stages"]["simulator"]["pid"], outcome["pid"], "{after:#}");
    let heard = observer.stop();
    observer::assert_gap_free("odometry/pose", heard.poses.iter().map(|pose| pose.frame.seq));
    observer::assert_gap_free("map_saver", heard.acks_of("map_saver"));
    for stage in &STAGES[1..] {
        let frames = &after["stages"][stage]["frames"];
        assert!(frames["lost"] == 0 && frames["imu_lost"] == 0, "{stage}: {after:#}");
    }
    up.signal(Signal::TERM);
    up.end().expect_success();
}

#[test]
fn the_launcher_after_one_that_was_killed_ends_what_still_runs_and_says_what_it_found() {
    let bench = Bench::new();
    let file = pipeline(&bench, "mode = \"live\"", "live", "seed = 5");
    let up = Running::start(bench.evac(["up", &file]));
    let before = wait_for_frames(&bench, 3);
    // A stage that is stopped does not hear that its launcher has died. Handed to init it would: the kernel wakes stopped process
    // groups that lose their session. So it is handed to this process.
    set_child_subreaper(Some(getpid())).unwrap();
    let lio = &before["stages"]["lio"]["pid"];
    signal(lio, Signal::STOP);
    // With kill -9. (Its output stays open, as the stopped stage has it too.)
    drop(up);
    let state = || {
        let status = std::fs::read_to_string(format!("/proc/{lio}/status")).unwrap_or_default();
        status
            .lines()
            .find_map(|line| line.strip_prefix("State:\t").map(|state| state.chars().next().unwrap()))
    };
    assert_eq!(state(), Some('T'), "it outlives the launcher that did not clean up");

    let up = Running::start(bench.evac(["up", &file]));
    let after = wait_for_frames(&bench, 3);
    assert!(matches!(state(), None | Some('Z')), "{:?}", state());
    assert!(STAGES.iter().all(|stage| after["stages"][stage]["pid"] != before["stages"][stage]["pid"]));
    up.signal(Signal::TERM);
    let ended = up.end().expect_success();
    let said = ended.stderr.lines().find(|line| line.contains("was killed in this domain")).unwrap();
    println!("{said}");
    for word in [&format!("killed: lio (pid {lio})"), "shared memory freed: ", "control socket: replaced"] {
        assert!(said.contains(word), "no '{word}' in {said}");
    }
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_stage_is_scheduled_as_the_pipeline_file_says_or_does_not_start() {
    let bench = Bench::new();
    let run = |scheduling: &str| {
        let text = format!("[[stage]]\nkind = \"deskewer\"\n[stage.scheduling]\n{scheduling}\n");
        let file = bench.write("p.toml", text);
        let words =
            ["stage", "deskewer", "--config", file.to_str().unwrap(), "--domain", bench.domain.name()];
        Running::start(bench.evac(words))
    };
    // A processor that is not there.
    run("cpus = [1023]").end().expect_error(3, &["scheduling.cpus", "1023", "nproc"]);
    let _lock = bench.domain.lock().unwrap();
    let mut running = run("cpus = [0]\nfifo_priority = 5\nlock_memory = true");
    let field = |pid: i32, name: &str| {
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
        status.lines().find_map(|line| line.strip_prefix(name).map(|value| value.trim().to_owned()))
    };
    let pid = running.pid();
    let taken = wait_for("the stage to run or to end", || {
        if !running.is_running() {
            return Some(false);
        }
        (field(pid, "VmLck:").is_some_and(|locked| locked != "0 kB")
            && std::fs::read_dir(bench.domain.folder().join("nodes"))
                .is_ok_and(|mut nodes| nodes.next().is_some()))
        .then_some(true)
    });
    if !taken {
        let ended = running.end();
        assert!(ended.code == 3 && ended.stderr.contains("Limit"), "{}", ended.stderr);
        println!(
            "skipped: this user may not have real-time priority or locked memory: {}",
            ended.stderr.trim()
        );
        return;
    }
    assert_eq!(field(pid, "Cpus_allowed_list:").unwrap(), "0");
    // Policy and priority are fields 41 and 40 of proc(5)'s stat; 1 is SCHED_FIFO.
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<_> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    assert_eq!((fields[41 - 3], fields[40 - 3]), ("1", "5"));
    running.signal(Signal::TERM);
    running.end().expect_success();
}
