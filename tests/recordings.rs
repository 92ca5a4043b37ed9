//! `evac map` on the simulated walks and bags, which a user's clone does not have.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use std::path::Path;

use common::{Bench, Ended};
use serde_json::Value;

/// The rig file of a walk's meta.json.
fn rig(meta: &Path) -> String {
    let meta: Value = serde_json::from_str(&std::fs::read_to_string(meta).unwrap()).unwrap();
    let value = |i: usize| meta["T_imu_lidar_xyz_ypr"][i].as_f64().unwrap();
    format!(
        "[rig.imu_from_lidar]\ntranslation_m = [{:?}, {:?}, {:?}]\nroll_pitch_yaw_deg = [{:?}, {:?}, {:?}]\n",
        value(0),
        value(1),
        value(2),
        value(5),
        value(4),
        value(3)
    )
}

fn map(bench: &Bench, args: &[&str], output: &str) -> Ended {
    bench.run(["map"].iter().chain(args).chain(&["-o", output])).expect_success()
}

fn assert_outputs(bench: &Bench, output: &str, frames: usize) -> Value {
    for file in ["map.ot", "map.bt", "plan.pgm", "plan.yaml", "plan.png", "cloud.pcd"] {
        assert!(!bench.bytes(&format!("{output}/{file}")).is_empty(), "{file}");
    }
    assert_eq!(bench.text(&format!("{output}/trajectory.tum")).lines().count(), frames);
    let summary: Value = serde_json::from_str(&bench.text(&format!("{output}/summary.json"))).unwrap();
    assert_eq!(summary["frames_lost"], 0);
    assert_eq!(summary["frames"], frames);
    summary
}

fn assert_same(bench: &Bench, a: &str, b: &str) {
    for file in ["trajectory.tum", "map.ot", "map.bt", "plan.pgm"] {
        assert!(bench.bytes(&format!("{a}/{file}")) == bench.bytes(&format!("{b}/{file}")), "{file} differs");
    }
}

fn walk(name: &str, frames: usize, max_end_percent: f64) {
    let Some(folder) = evac_testkit::data(&format!("simulated/{name}")) else { return };
    let file = |name: &str| evac_testkit::unpacked(&format!("simulated/{name}"));
    let (Some(lidar), Some(imu)) = (file(&format!("{name}/lidar.pcap")), file(&format!("{name}/wt901c.bin")))
    else {
        return;
    };
    let bench = Bench::new();
    bench.write("rig.toml", rig(&folder.join("meta.json")));
    let truth = folder.join("gt.tum");
    let args = [
        "--lidar",
        lidar.to_str().unwrap(),
        "--imu",
        imu.to_str().unwrap(),
        "--rig",
        "rig.toml",
        "--truth",
        truth.to_str().unwrap(),
    ];
    map(&bench, &args, "a");
    map(&bench, &args, "b");
    let summary = assert_outputs(&bench, "a", frames);
    let drift = &summary["drift"];
    println!("{name}: {drift}");
    assert_eq!(drift["frames"], frames);
    assert!(drift["end_percent"].as_f64().unwrap() < max_end_percent, "{name}: {drift}");
    assert_same(&bench, "a", "b");
}

#[test]
fn the_corridor_walk_ends_within_2_percent_and_maps_the_same_twice() {
    walk("corridor", 531, 2.0);
}

#[test]
fn the_hall_walk_ends_within_2_percent_and_maps_the_same_twice() {
    walk("hall", 447, 2.0);
}

#[test]
fn the_shaken_walk_ends_within_3_percent_and_maps_the_same_twice() {
    walk("shake", 213, 3.0);
}

#[test]
fn both_bags_map_without_losing_a_frame_and_the_same_twice() {
    for (name, frames) in [("hall_first_6s_bz2", 60), ("hall_first_2s_lz4", 20)] {
        let Some(bag) = evac_testkit::data(&format!("simulated/bags/{name}.bag")) else { return };
        let bench = Bench::new();
        let bag = bag.to_str().unwrap();
        map(&bench, &[bag], "a");
        map(&bench, &[bag], "b");
        assert_outputs(&bench, "a", frames);
        assert_same(&bench, "a", "b");
    }
}
