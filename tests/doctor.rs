//! `evac doctor` on this machine, with a module on a pseudo-terminal and a stage that was killed.
#![allow(clippy::unwrap_used)]

mod common;

use std::time::{Duration, Instant};

use common::{Bench, WATCHDOG};
use evac_simulator::devices::wt901c;
use serde_json::Value;

/// The findings on a topic: grade, text and remedy.
fn findings(json: &Value, topic: &str) -> Vec<(String, String, String)> {
    let word = |finding: &Value, key: &str| finding[key].as_str().unwrap().to_owned();
    let all = json["findings"].as_array().unwrap().iter().filter(|finding| finding["topic"] == topic);
    all.map(|finding| (word(finding, "grade"), word(finding, "text"), word(finding, "remedy"))).collect()
}

fn doctor(bench: &Bench, args: &[&str]) -> (i32, Value) {
    let ended = bench.run(["doctor", "--json"].iter().chain(args));
    (ended.code, serde_json::from_str(&ended.stdout).unwrap())
}

#[test]
fn the_devices_of_a_pipeline_file_are_looked_at_and_an_absent_one_is_a_fault_with_a_remedy() {
    let bench = Bench::new();
    let port = bench.path("evac-imu");
    let file = format!(
        "domain = \"{}\"\n[[stage]]\nkind = \"imu\"\n[stage.config]\nport = \"{}\"\n",
        bench.domain.name(),
        port.display()
    );
    bench.write("robot.toml", file);
    let (code, json) = doctor(&bench, &["robot.toml"]);
    assert_eq!((code, &json["can_run"]), (4, &Value::Bool(false)));
    let imu = findings(&json, "imu");
    assert_eq!(imu.len(), 1, "{imu:?}");
    assert!(imu[0].0 == "fault" && imu[0].1.contains("evac-imu") && imu[0].2.contains("by-id"), "{imu:?}");

    let at_rest = |_| ([0, 0, 2048], [0; 3]);
    let module = wt901c::Bench::start(&port, wt901c::Module::new(wt901c::Line::Serial), at_rest).unwrap();
    let (_, json) = doctor(&bench, &["robot.toml"]);
    let imu = findings(&json, "imu");
    assert!(imu[0].0 == "good" && imu[0].1.contains("9600 baud"), "{imu:?}");
    // It was only listened to.
    assert_eq!(module.port().module.baud(), 9600);
    assert!(
        findings(&json, "serial port")
            .iter()
            .any(|(grade, text, _)| grade == "good" && text.contains("evac-imu"))
    );

    module.port().faults = wt901c::Faults { silent: true, ..wt901c::Faults::default() };
    let (code, json) = doctor(&bench, &["robot.toml"]);
    let imu = findings(&json, "imu");
    assert!(code == 4 && imu[0].0 == "fault" && imu[0].1.contains("no WT901C at any speed"), "{imu:?}");
}

#[test]
fn what_a_killed_stage_left_is_named_until_it_is_cleaned_and_a_living_one_is_left_alone() {
    let bench = Bench::new();
    let name = bench.domain.name().to_owned();
    let mut stage = bench.evac(["stage", "deskewer", "--domain", &name]).spawn().unwrap();
    let until = Instant::now() + WATCHDOG;
    while bench.leftovers().len() < 10 {
        assert!(Instant::now() < until, "the stage opens no services");
        std::thread::sleep(Duration::from_millis(20));
    }
    let about_us = |json: &Value| {
        let all = findings(json, "shared memory");
        all.into_iter().find(|(_, text, _)| text.contains(&format!("'{name}'")))
    };
    assert_eq!(about_us(&doctor(&bench, &[]).1), None);
    stage.kill().unwrap();
    stage.wait().unwrap();
    let (_, json) = doctor(&bench, &[]);
    let (grade, text, remedy) = about_us(&json).unwrap();
    assert!(grade == "advice" && text.contains("files") && remedy.contains("--clean"), "{text}");
    assert!(!bench.leftovers().is_empty());
    // Only ours: other tests on this machine leave and clean what is theirs.
    drop(bench.domain.lock().unwrap());
    assert_eq!(about_us(&doctor(&bench, &[]).1), None);
}

#[test]
fn every_advice_says_what_to_do_and_the_text_is_what_the_json_says() {
    let bench = Bench::new();
    let (_, json) = doctor(&bench, &[]);
    for topic in ["shared memory", "clock", "processor", "serial port", "lidar"] {
        let found = findings(&json, topic);
        assert!(!found.is_empty(), "{topic}");
        assert!(found.iter().all(|(grade, _, remedy)| grade == "good" || !remedy.is_empty()), "{found:?}");
    }
    let ended = bench.run(["doctor", "no/such/file.toml"]);
    assert!(ended.code == 4 && ended.stdout.contains("no/such/file.toml"), "{}", ended.stdout);
    assert!(ended.stderr.contains("would stop a run"), "{}", ended.stderr);
}
