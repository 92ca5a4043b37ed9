//! Faults at random, and what holds whatever happens.
#![allow(clippy::unwrap_used)]

mod common;

use common::Bench;
use serde_json::Value;

/// Every stage is swapped once before each of the two times that what is held is measured.
const MUSTERED: usize = 12;

#[test]
fn ninety_seconds_of_kills_stops_swaps_and_shadows_lose_double_stall_and_leak_nothing_that_is_not_stated() {
    let bench = Bench::new();
    let words = [
        "chaos",
        "--minutes",
        "1.5",
        "--seed",
        "13",
        "--rate",
        "0.5",
        "--output",
        "out",
        "--domain",
        bench.domain.name(),
    ];
    let ended = bench.run(words);
    println!("{}", ended.stdout);
    let ended = ended.expect_success();
    assert!(ended.stdout.contains("nothing happened that must not"), "{}", ended.stdout);
    let report: Value = serde_json::from_str(&bench.text("out/chaos.json")).unwrap();
    let faults = report["faults"].as_array().unwrap();
    assert!(faults.len() >= MUSTERED + 3, "{report:#}");
    assert!(faults.iter().all(|fault| fault["whole_s"].is_number()), "{report:#}");
    let shadow = faults.iter().find(|fault| fault["deed"] == "shadow").unwrap();
    assert!(shadow["remark"].as_str().unwrap().contains("frames of both"), "{shadow}");
    // What is measured is there: a process that is not found holds nothing.
    for moment in ["before", "after"] {
        let stages = report[moment]["stages"].as_object().unwrap();
        assert_eq!(stages.len(), 6, "{report:#}");
        for held in stages.values() {
            assert!(held["descriptors"].as_u64() > Some(20), "{report:#}");
            assert!(held["anonymous_mib"].as_f64() > Some(0.5), "{report:#}");
        }
    }
    for sink in ["grid_exporter", "map_saver"] {
        assert!(report["sinks"][sink]["frames"].as_u64() > Some(100), "{report:#}");
    }
    assert!(report["map_equal"] == true && report["violations"] == Value::Array(Vec::new()), "{report:#}");
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}
