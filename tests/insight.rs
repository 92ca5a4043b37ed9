//! What one sees of a running pipeline: status, one frame's way, the live display on a real terminal, and logs for programs.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;
#[path = "common/terminal.rs"]
mod terminal;
#[path = "common/walk.rs"]
mod walk;

use common::{Bench, Running, wait_for};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use terminal::Terminal;
use walk::{STAGES, pipeline, status, wait_for_frames};

/// A walk in real time that lasts until it is ended.
fn long_walk(bench: &Bench) -> String {
    pipeline(bench, "mode = \"live\"", "maps", "seed = 3\nlaps = 100")
}

/// A pipeline all of whose stages put out frames.
fn running(bench: &Bench) -> (Running, Value) {
    let up = Running::start(bench.evac(["up", &long_walk(bench)]));
    let status = wait_for_frames(bench, 5);
    (up, status)
}

fn end(up: Running) {
    up.signal(Signal::TERM);
    up.end().expect_success();
}

#[test]
fn status_says_who_is_routed_what_was_started_again_and_what_each_process_takes() {
    let bench = Bench::new();
    let (up, before) = running(&bench);
    assert_eq!(before["order"], serde_json::json!(STAGES));
    for stage in STAGES {
        let stage = &before["stages"][stage];
        assert!(stage["cpu_percent"].as_f64().unwrap() >= 0.0, "{stage:#}");
        assert!(stage["memory"]["own_bytes"].as_u64() > Some(100_000), "{stage:#}");
        assert!(stage["memory"]["shared_bytes"].as_u64() > Some(100_000), "{stage:#}");
        assert_eq!((&stage["restarts"], &stage["route"]["epoch"]), (&0.into(), &0.into()), "{stage:#}");
        assert!(stage["route"]["from_seq"].is_null(), "{stage:#}");
    }
    assert_eq!(before["stages"]["lio"]["route"]["service"], "odometry/pose");
    assert_eq!(
        [&before["stages"]["simulator"]["role"], &before["stages"]["map_saver"]["role"]],
        ["producer", "consumer"]
    );
    let [pose, plan] = ["pose", "plan"].map(|to| before["sensor_to"][to]["p50_ms"].as_f64().unwrap());
    assert!(pose > 0.0 && plan > pose, "{before:#}");

    let pid = i32::try_from(before["stages"]["deskewer"]["pid"].as_i64().unwrap()).unwrap();
    kill_process(Pid::from_raw(pid).unwrap(), Signal::KILL).unwrap();
    let after = wait_for("the deskewer to run again", || {
        let status = status(&bench)?;
        (status["stages"]["deskewer"]["frames"]["out"].as_u64() > Some(3)
            && status["stages"]["deskewer"]["restarts"] == 1)
            .then_some(status)
    });
    let deskewer = &after["stages"]["deskewer"];
    assert_eq!((&deskewer["route"]["epoch"], &deskewer["epoch"]), (&1.into(), &1.into()), "{deskewer:#}");
    assert_ne!(deskewer["pid"], before["stages"]["deskewer"]["pid"]);
    let standby = ["standby", "deskewer", "--domain", bench.domain.name()];
    bench.run(standby).expect_success();
    let table = wait_for("the standby in the table", || {
        let table = bench.run(["status", "--domain", bench.domain.name()]).expect_success().stdout;
        table.contains("deskewer #2").then_some(table)
    });
    let line = |name: &str| table.lines().find(|line| line.starts_with(name)).unwrap().trim_end();
    assert!(line("deskewer #2").ends_with("no") && line("deskewer #2").contains("standby"), "{table}");
    assert!(line("lio").ends_with("start"), "{table}");
    end(up);
}

#[test]
fn a_trace_shows_one_frame_in_every_stage_with_its_times_in_order() {
    let bench = Bench::new();
    let (up, status) = running(&bench);
    let domain = bench.domain.name();
    let newest = status["stages"]["deskewer"]["last_seq"].as_u64().unwrap();
    let trace = bench.run(["trace", "--domain", domain, "--json", "--png", "trace.png"]).expect_success();
    let trace: Value = serde_json::from_str(&trace.stdout).unwrap();
    assert!(trace["seq"].as_u64().unwrap() > newest, "{trace:#}");
    assert_eq!(trace["silent"], Value::Array(Vec::new()), "{trace:#}");
    let hops = trace["hops"].as_array().unwrap();
    let names: Vec<_> = hops.iter().map(|hop| hop["stage"].as_str().unwrap()).collect();
    assert_eq!(names, STAGES[1..]);
    for hop in hops {
        let [sent, received, begun, done] =
            ["sent_ms", "received_ms", "begun_ms", "done_ms"].map(|key| hop[key].as_f64().unwrap());
        assert!(0.0 <= sent && sent <= received && received <= begun && begun <= done, "{hop:#}");
    }
    // What the deskewer is done with is what lio is given, and so on.
    for pair in hops[..4].windows(2) {
        assert!(pair[1]["sent_ms"].as_f64().unwrap() <= pair[0]["done_ms"].as_f64().unwrap(), "{trace:#}");
    }
    assert!(bench.bytes("trace.png").starts_with(b"\x89PNG"));

    let later = (trace["seq"].as_u64().unwrap() + 40).to_string();
    let text = bench.run(["trace", "--domain", domain, "--seq", &later]).expect_success().stdout;
    assert!(text.starts_with(&format!("frame {later}:")) && text.contains('#'), "{text}");
    assert!(STAGES[1..].iter().all(|stage| text.contains(stage)), "{text}");
    bench
        .run(["trace", "--domain", domain, "--seq", "1"])
        .expect_error(4, &["frame 1", "has passed", "--next"]);
    end(up);
    bench.run(["trace", "--domain", domain]).expect_error(5, &["no pipeline runs"]);
}

#[test]
fn top_shows_all_stages_on_a_terminal_of_any_size_and_leaves_it_as_it_was() {
    let bench = Bench::new();
    let (up, _) = running(&bench);
    let args = ["top", "--domain", bench.domain.name()];
    // Wide, in colour.
    let mut wide = Terminal::start(bench.evac(args), (40, 170));
    let text = wide.wait_for("all stages", |text| STAGES.iter().all(|stage| text.contains(stage)));
    for word in
        ["end to end ms", "restarts", "leads", "sensor to pose", "degenerate", "q quits", bench.domain.name()]
    {
        assert!(text.contains(word), "no '{word}' on\n{text}");
    }
    assert!(wide.is_alternate() && wide.is_raw() && wide.has_colours());
    wide.resize((40, 60));
    wide.wait_for("a narrow table", |text| text.contains("lio") && !text.contains("restarts"));
    wide.type_keys("q");
    assert_eq!(wide.end(), 0);
    // Small: it scrolls.
    let mut small = Terminal::start(bench.evac(args), (7, 44));
    let text =
        small.wait_for("the first stages", |text| text.contains("simulator") && text.contains("more rows"));
    assert!(!text.contains("map_saver"), "{text}");
    for _ in 0..6 {
        small.type_keys("j");
    }
    small.wait_for("the last stage", |text| text.contains("map_saver") && !text.contains("simulator"));
    small.signal(Signal::TERM);
    assert_eq!(small.end(), 0);
    // Without colour.
    let mut command = bench.evac(args);
    command.env("NO_COLOR", "1");
    let mut plain = Terminal::start(command, (40, 170));
    plain.wait_for("all stages", |text| STAGES.iter().all(|stage| text.contains(stage)));
    assert!(!plain.has_colours());
    // It goes when the pipeline goes.
    end(up);
    plain.wait_for("the end", |text| text.contains("has ended"));
    assert_eq!(plain.end(), 0);
    bench.run(args).expect_error(5, &["no pipeline runs"]);
}

#[test]
fn every_line_of_a_json_log_is_json_that_of_a_failure_too() {
    let bench = Bench::new();
    let file = long_walk(&bench);
    let mut command = bench.evac(["up", &file, "--log-level", "debug"]);
    command.env("EVAC_LOG_FORMAT", "json");
    let up = Running::start(command);
    // Three times a minute it is started again, then the run fails.
    let mut killed = 0;
    for _ in 0..4 {
        killed = wait_for("a simulator", || {
            let pid = status(&bench)?["stages"]["simulator"]["pid"].as_i64()?;
            (pid != killed).then_some(pid)
        });
        kill_process(Pid::from_raw(i32::try_from(killed).unwrap()).unwrap(), Signal::KILL).unwrap();
    }
    let ended = up.end();
    assert_eq!(ended.code, 1);
    let lines = parsed(&ended.stderr);
    assert!(lines.iter().all(|line| line["level"].is_string() && line["timestamp"].is_string()));
    let said = |word: &str| {
        lines.iter().any(|line| line["fields"]["message"].as_str().is_some_and(|m| m.contains(word)))
    };
    assert!(said("all stages are up") && said("signal 9"), "{}", ended.stderr);

    // A stage by itself, by option, and what is wrong with it.
    let args = ["stage", "deskewer", "--log-format", "json", "--domain", "no/domain"];
    let ended = bench.run(args);
    assert_eq!(ended.code, 3);
    assert_eq!(parsed(&ended.stderr).len(), 1, "{}", ended.stderr);
    let mut command = bench.evac(["stage", "deskewer"]);
    command.env("EVAC_LOG_FORMAT", "xml");
    let ended = Running::start(command).end();
    assert!(ended.code == 2 && ended.stderr.contains("xml"), "{}", ended.stderr);
}

#[track_caller]
fn parsed(text: &str) -> Vec<Value> {
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|cause| panic!("{cause}: {line}")))
        .collect()
}
