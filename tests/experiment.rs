//! `evac experiment` on short walks: every experiment runs, prints and writes what it says.
#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeSet;

use common::{Bench, Running, wait_for};
use rustix::process::Signal;
use serde_json::Value;

/// A simulated walk, six seconds of it: three of them standing.
const SHORT: [&str; 6] = ["--only", "corridor_21", "--duration", "6", "-o", "out"];

fn experiment(bench: &Bench, name: &str, more: &[&str]) -> (String, Value) {
    let args = [&["experiment", name][..], &SHORT, more].concat();
    let ended = bench.run(args).expect_success();
    let json = serde_json::from_str(&bench.text(&format!("out/{name}.json"))).unwrap();
    assert!(bench.text(&format!("out/{name}.md")).contains("| ---: |"));
    (ended.stdout, json)
}

#[test]
fn walks_prints_a_line_a_run_and_writes_table_and_figures() {
    let bench = Bench::new();
    let (stdout, json) = experiment(&bench, "walks", &["--fault", "none,auto-zero"]);
    let lines: Vec<_> = stdout.lines().filter(|line| line.starts_with("corridor_21")).collect();
    assert_eq!(lines.len(), 2, "{stdout}");
    assert!(lines.iter().all(|line| line.ends_with("held")), "{stdout}");
    let runs = json["runs"].as_array().unwrap();
    assert_eq!((runs[0]["fault"].as_str(), runs[1]["fault"].as_str()), (Some("none"), Some("auto-zero")));
    assert!(runs.iter().all(|run| run["figures"]["ape_m"].as_f64().unwrap() < 0.05));
    assert_eq!(json["acceptance"].as_array().unwrap().len(), 4);
}

#[test]
fn a_changed_configuration_reaches_the_odometry_and_is_named_in_the_results() {
    let bench = Bench::new();
    let start = |json: &Value| json["runs"][0]["figures"]["start_s"].as_f64().unwrap();
    let (_, usual) = experiment(&bench, "walks", &[]);
    let (_, later) = experiment(&bench, "walks", &["--set", "lio.standstill_s=2"]);
    assert!(start(&later) > start(&usual) + 0.5);
    assert_eq!(later["set"][0], "lio.standstill_s=2");
}

#[test]
fn faults_prints_a_row_a_fault() {
    let bench = Bench::new();
    let (stdout, json) = experiment(&bench, "faults", &["--fault", "none,imu-100hz,stamps-from-epoch"]);
    for row in ["| none |", "| imu-100hz |", "| stamps-from-epoch |"] {
        assert!(stdout.contains(row), "{stdout}");
    }
    assert_eq!(json["runs"].as_array().unwrap().len(), 3);
}

#[test]
fn honesty_says_how_many_errors_are_within_three_sigma() {
    let bench = Bench::new();
    let (stdout, json) = experiment(&bench, "honesty", &[]);
    assert!(stdout.contains("| corridor_21 |") && stdout.contains("within 3 sigma"), "{stdout}");
    assert_eq!(json["acceptance"][0]["limit"], 95.0);
}

#[test]
fn table1_gives_the_ten_figures_of_every_method_and_draws_them() {
    let bench = Bench::new();
    let ended = bench.run(["experiment", "table1", "--duration", "6", "-o", "out"]).expect_success();
    for row in ["| average |", "| standard error |", "| number |", "| displacement of the end point, m |"] {
        assert!(ended.stdout.contains(row), "{}", ended.stdout);
    }
    let json: Value = serde_json::from_str(&bench.text("out/table1.json")).unwrap();
    for method in json["methods"].as_array().unwrap() {
        assert!(method["z_figures"]["number"].as_u64().unwrap() > 20, "{method}");
    }
    for picture in ["out/path.png", "out/axes.png"] {
        assert!(bench.bytes(picture).starts_with(b"\x89PNG"));
    }
}

#[test]
fn a_minute_of_soak_runs_the_real_processes_and_leaves_nothing_behind() {
    let bench = Bench::new();
    let args = ["experiment", "soak", "--minutes", "1", "-o", "out", "--domain", bench.domain.name()];
    let ended = bench.run(args).expect_success();
    assert!(ended.stdout.contains("memory: at most"), "{}", ended.stdout);
    let json: Value = serde_json::from_str(&bench.text("out/soak.json")).unwrap();
    let minutes = json["minutes"].as_array().unwrap();
    assert_eq!(minutes.len(), 1);
    assert!(minutes[0]["process"]["resident_mb"].as_f64().unwrap() > 1.0);
    assert!(minutes[0]["cpu_ms"].as_f64().unwrap() > 0.0 && minutes[0]["median_ms"].as_f64().unwrap() > 0.0);
    assert!(minutes[0]["drift_m"].as_f64().unwrap() < 1.0);
    assert!(bench.bytes("out/soak.png").starts_with(b"\x89PNG"));
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_producer_that_never_waits_for_anybody_reports_while_it_works() {
    let bench = Bench::new();
    let domain = bench.domain.name().to_owned();
    let soak = Running::start(bench.evac(["experiment", "soak", "-o", "out", "--domain", &domain]));
    // Scans that it had put out by each of its reports; the sink of a soak holds nobody up.
    let mut reported = BTreeSet::new();
    wait_for("three reports of the simulator", || {
        let ended = bench.run(["status", "--domain", &domain, "--json"]);
        let status: Value = serde_json::from_str(&ended.stdout).ok()?;
        reported.extend(status["stages"]["simulator"]["frames"]["out"].as_u64());
        (reported.len() >= 3).then_some(())
    });
    soak.signal(Signal::TERM);
    soak.end();
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}

#[test]
fn a_wrong_name_is_answered_with_the_right_ones() {
    let bench = Bench::new();
    let walks = |more: [&str; 2]| bench.run([&["experiment", "walks"][..], &more].concat());
    walks(["--only", "no-such-walk"]).expect_error(3, &["no-such-walk", "corridor_21"]);
    walks(["--fault", "rain"]).expect_error(3, &["rain", "gyro-spike"]);
    walks(["--set", "lio.no_such_key=1"]).expect_error(3, &["no_such_key"]);
    walks(["--duration", "0"]).expect_error(3, &["--duration"]);
}

#[test]
fn restarts_prints_a_line_a_killed_stage_and_what_it_cost() {
    let bench = Bench::new();
    let stages = ["grid_exporter", "recorder"];
    let args = ["experiment", "restarts", "--only", "grid_exporter,recorder", "-o", "out"];
    let ended = bench.run(args).expect_success();
    assert!(ended.stdout.contains("every frame that a sink misses is stated: held"), "{}", ended.stdout);
    println!("{}", ended.stdout);
    let json: Value = serde_json::from_str(&bench.text("out/restarts.json")).unwrap();
    for (kill, stage) in json["kills"].as_array().unwrap().iter().zip(stages) {
        assert_eq!(kill["stage"], stage);
        assert!(kill["next_seq"].as_u64() > kill["last_seq"].as_u64(), "{kill}");
        // Up before it puts out anything, which is before the rest has passed.
        let times = ["up_ms", "next_ms", "whole_ms"].map(|key| kill[key].as_f64().unwrap());
        assert!(times[0] > 0.0 && times[0] <= times[1] && times[0] <= times[2], "{kill}");
    }
    assert_eq!(json["kills"].as_array().unwrap().len(), stages.len());
    bench.run(["experiment", "restarts", "--only", "nobody"]).expect_error(3, &["nobody", "map_saver"]);
}
