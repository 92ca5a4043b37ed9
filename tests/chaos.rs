//! Faults at random, and what holds whatever happens.
#![allow(clippy::unwrap_used)]

mod common;

use common::Bench;
use serde_json::Value;

#[test]
fn a_minute_of_kills_stops_and_swaps_loses_doubles_stalls_and_leaks_nothing_that_is_not_stated() {
    let bench = Bench::new();
    let words = [
        "chaos",
        "--minutes",
        "1",
        "--seed",
        "1",
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
    assert!(report["faults"].as_array().unwrap().len() >= 3, "{report:#}");
    assert!(report["map_equal"] == true && report["violations"] == Value::Array(Vec::new()), "{report:#}");
    assert_eq!(bench.leftovers(), Vec::<String>::new());
}
