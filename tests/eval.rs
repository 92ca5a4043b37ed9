//! `evac eval` with the real binary: figures, files and what it says about bad input.
#![allow(clippy::unwrap_used)]

mod common;

use common::Bench;
use serde_json::Value;

const USAGE: i32 = 2;
const FILE: i32 = 4;

/// A walk of 20 m along x and 10 m along y, ten poses a second and a metre; `scale` stretches it, `lift` raises its end.
fn walk(start_s: f64, scale: f64, lift: f64) -> String {
    (0..=300)
        .map(|i| {
            let way = f64::from(i) * 0.1;
            let (x, y) = (way.min(20.0) * scale, (way - 20.0).max(0.0) * scale);
            format!("{:.6} {x:.6} {y:.6} {:.6} 0 0 0 1\n", start_s + way, lift * way / 30.0)
        })
        .collect()
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("truth.tum", walk(1_700_000_000.0, 1.0, 0.0));
    bench.write("good.tum", walk(12.5, 1.0, 0.3));
    bench.write("bad.tum", walk(12.5, 1.01, 0.0));
    bench
}

#[test]
fn two_methods_are_compared_in_a_table_in_json_and_in_two_pictures() {
    let bench = bench();
    let said = bench.run(["eval", "truth.tum", "good.tum", "bad.tum", "-o", "out"]).expect_success().stdout;
    let row = |name: &str| {
        let line = said.lines().find(|line| line.trim_start().starts_with(name)).unwrap();
        line.split_whitespace().rev().take(2).map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(said.lines().next().unwrap().trim_start().starts_with("good"), "{said}");
    assert_eq!(row("true path"), ["30.000", "30.000"]);
    assert_eq!(row("position (m)"), ["0.2236", "0.3000"], "{said}");
    assert_eq!(row("position (%"), ["0.7454", "1.0000"], "{said}");

    let report: Value = serde_json::from_slice(&bench.bytes("out/evaluation.json")).unwrap();
    let [good, bad] = [0, 1].map(|i| &report["estimates"][i]);
    assert_eq!((&good["name"], &good["frames"]), (&Value::from("good"), &Value::from(301)));
    let figure = |value: &Value| value.as_f64().unwrap();
    assert!((figure(&bad["rpe_1m"]["translation_m"]["median"]) - 0.01).abs() < 1e-5, "{bad:#}");
    assert!((figure(&good["z_figures"]["range"]) - 0.3).abs() < 1e-6);
    assert!((figure(&good["time_offset_s"]) - 1_699_999_987.5).abs() < 1e-6);
    for name in ["path.png", "axes.png"] {
        let picture = bench.bytes(&format!("out/{name}"));
        assert!(picture.starts_with(b"\x89PNG\r\n\x1a\n") && picture.len() > 5_000, "{name}");
    }
    // The same files give the same results.
    let before = bench.bytes("out/path.png");
    bench.run(["eval", "truth.tum", "good.tum", "bad.tum", "-o", "out"]).expect_success();
    assert_eq!(bench.bytes("out/path.png"), before);
    assert_eq!(std::fs::read_dir(bench.path("out")).unwrap().count(), 3);
}

#[test]
fn json_on_standard_output_is_what_the_file_holds() {
    let bench = bench();
    let said = bench.run(["eval", "truth.tum", "good.tum", "--json"]).expect_success().stdout;
    let (said, file): (Value, Value) = (
        serde_json::from_str(&said).unwrap(),
        serde_json::from_slice(&bench.bytes("evac-eval/evaluation.json")).unwrap(),
    );
    assert_eq!(said, file);
}

#[test]
fn an_estimate_that_begins_later_on_the_same_clock_is_noticed_and_compared_by_absolute_times() {
    let bench = bench();
    let late: String = walk(1_700_000_000.0, 1.0, 0.0).lines().skip(50).map(|l| format!("{l}\n")).collect();
    bench.write("late.tum", late);
    let said = bench.run(["eval", "truth.tum", "late.tum"]).expect_success();
    assert!(
        said.stderr.contains("begins 5.000 s after the truth") && said.stderr.contains("--absolute-time")
    );
    let said = bench.run(["eval", "truth.tum", "late.tum", "--absolute-time", "--json"]).expect_success();
    assert_eq!(said.stderr, "");
    let report: Value = serde_json::from_str(&said.stdout).unwrap();
    assert!(report["estimates"][0]["ape_first"]["max"].as_f64().unwrap() < 1e-5);
}

#[test]
fn a_demos_trajectory_agrees_with_its_summary() {
    let bench = Bench::new();
    let args = ["demo", "--duration", "8", "--domain", bench.domain.name(), "-o", "out"];
    bench.run(args).expect_success();
    bench.run(["eval", "out/truth.tum", "out/trajectory.tum", "-o", "out"]).expect_success();
    let [summary, report]: [Value; 2] = ["out/summary.json", "out/evaluation.json"]
        .map(|name| serde_json::from_slice(&bench.bytes(name)).unwrap());
    let (drift, figures) = (&summary["drift"], &report["estimates"][0]);
    for name in ["frames", "path_m", "end_m", "end_percent", "end_rotation_deg"] {
        assert_eq!(drift[name], figures[name], "{name}");
    }
    assert_eq!(drift["ape_rmse_m"], figures["ape_se3"]["rmse"]);
}

#[test]
fn files_that_cannot_be_compared_are_named_with_cause_and_remedy() {
    let bench = bench();
    let eval = |args: &[&str]| bench.run(["eval"].iter().chain(args));
    eval(&["nowhere.tum", "good.tum"]).expect_error(FILE, &["nowhere.tum", "check the path"]);
    eval(&["truth.tum", "nowhere.tum"]).expect_error(FILE, &["nowhere.tum", "check the path"]);
    bench.write("words.tum", "0.1 1 2 3 0 0 0 one\n");
    eval(&["truth.tum", "words.tum"]).expect_error(FILE, &["words.tum", "byte 0", "one"]);
    bench.write("empty.tum", "# nothing\n");
    eval(&["empty.tum", "good.tum"]).expect_error(FILE, &["empty.tum", "the truth has too few poses (0,"]);
    bench.write("one.tum", "0.1 1 2 3 0 0 0 1\n");
    eval(&["truth.tum", "one.tum"]).expect_error(FILE, &["one.tum", "the estimate has too few poses (1,"]);
    bench.write("back.tum", "0.2 1 2 3 0 0 0 1\n0.3 1 2 3 0 0 0 1\n0.1 1 2 3 0 0 0 1\n");
    eval(&["truth.tum", "back.tum"]).expect_error(FILE, &["back.tum", "pose 3", "sort the poses"]);
    eval(&["back.tum", "good.tum"]).expect_error(FILE, &["back.tum", "the truth: pose 3"]);
    eval(&["truth.tum", "good.tum", "--absolute-time"])
        .expect_error(FILE, &["good.tum", "1700000000.000000000 s", "12.500000000 s", "--absolute-time"]);
    bench.write("file", "");
    eval(&["truth.tum", "good.tum", "-o", "file"]).expect_error(FILE, &["file", "-o"]);
    assert_eq!(eval(&["truth.tum"]).code, USAGE);
    assert!(!bench.path("evac-eval").exists(), "nothing is written where nothing could be compared");
}
