//! Bad input gives one clear error with its place and remedy, and the exit code that its kind has.
#![allow(clippy::unwrap_used)]

mod common;

use common::Bench;

const USAGE: i32 = 2;
const CONFIGURATION: i32 = 3;
const FILE: i32 = 4;

#[test]
fn recordings_that_are_missing_empty_wrong_or_cut() {
    let bench = Bench::new();
    bench.run(["map", "nowhere.bag"]).expect_error(FILE, &["nowhere.bag", "check the path"]);
    bench.write("empty.bag", "");
    bench.run(["map", "empty.bag"]).expect_error(FILE, &["empty.bag", "byte 0"]);
    bench.write("text.bag", "this is no bag at all, it is a text");
    bench.run(["map", "text.bag"]).expect_error(FILE, &["text.bag", "byte 0"]);
    bench.write("cut.bag", "#ROSBAG V2.0\n\x45\x00\x00\x00abc");
    bench.run(["map", "cut.bag"]).expect_error(FILE, &["cut.bag", "byte 13"]);

    bench.write("imu.bin", [0x55_u8; 1000]);
    bench.write("empty.pcap", "");
    bench
        .run(["map", "--lidar", "empty.pcap", "--imu", "imu.bin"])
        .expect_error(FILE, &["empty.pcap", "byte 0"]);
    bench.write("text.pcap", "this is no capture at all, it is a text");
    bench
        .run(["map", "--lidar", "text.pcap", "--imu", "imu.bin"])
        .expect_error(FILE, &["text.pcap", "byte 0"]);
    bench.run(["map", "--lidar", ".", "--imu", "imu.bin"]).expect_error(FILE, &["is not a file"]);
    assert!(!bench.path("evac-out/map.ot").exists());
}

#[test]
fn a_recording_cut_in_the_middle_of_a_packet() {
    let bench = Bench::new();
    let walk = bench.path("walk");
    let args = ["demo", "--duration", "3", "--domain", bench.domain.name(), "--record", "walk", "-o", "out"];
    bench.run(args).expect_success();
    let mut pcap = std::fs::read(walk.join("lidar.pcap")).unwrap();
    pcap.truncate(pcap.len() - 700);
    bench.write("cut.pcap", &pcap);
    let map = ["map", "--lidar", "cut.pcap", "--imu", "walk/wt901c.bin", "-o", "cut"];
    bench.run(map).expect_error(FILE, &["cut.pcap", "byte ", "--allow-truncated"]);
    // What is before the cut is still a walk.
    bench.run(map.iter().chain(&["--allow-truncated"])).expect_success();
    assert_eq!(bench.text("cut/trajectory.tum").lines().count(), 30);

    // An IMU log that is no IMU log.
    bench.write("noise.bin", (0..9000_u32).map(|i| (i * 7 % 251) as u8).collect::<Vec<_>>());
    bench
        .run(["map", "--lidar", "walk/lidar.pcap", "--imu", "noise.bin", "-o", "noise"])
        .expect_error(FILE, &["noise.bin"]);
    // The two files swapped.
    bench
        .run(["map", "--lidar", "walk/wt901c.bin", "--imu", "walk/lidar.pcap", "-o", "swapped"])
        .expect_error(FILE, &["wt901c.bin"]);
}

#[test]
fn clouds_that_are_missing_empty_wrong_or_cut() {
    let bench = Bench::new();
    let convert = |cloud: &str| bench.run(["convert", cloud, "--resolution", "0.1", "-o", "map.bt"]);
    convert("nowhere.pcd").expect_error(FILE, &["nowhere.pcd", "check the path"]);
    bench.write("empty.pcd", "");
    convert("empty.pcd").expect_error(FILE, &["empty.pcd", "byte 0"]);
    let header =
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ";
    bench.write("cut.pcd", format!("{header}binary\n0123456789ab0123"));
    convert("cut.pcd").expect_error(FILE, &["cut.pcd", "1 of 2 points"]);
    bench.write("words.pcd", format!("{header}ascii\n1 2 3\n4 five 6\n"));
    convert("words.pcd").expect_error(FILE, &["words.pcd", "five"]);
    assert!(!bench.path("map.bt").exists());

    bench.write("nan.pcd", format!("{header}ascii\n1 2 3\nnan 5 6\n"));
    let said = convert("nan.pcd").expect_success().stdout;
    assert!(said.contains("1 not finite"), "{said}");
    bench
        .run(["convert", "nan.pcd", "--resolution", "0", "-o", "map.bt"])
        .expect_error(CONFIGURATION, &["--resolution"]);
    bench
        .run(["convert", "nan.pcd", "--resolution", "1", "-o", "map.txt"])
        .expect_error(CONFIGURATION, &[".bt", ".ot"]);
    bench
        .run(["convert", "nan.pcd", "--resolution", "1", "-o", "no/map.bt"])
        .expect_error(FILE, &["no/map.bt"]);
}

#[test]
fn configurations_that_cannot_work_are_refused_before_anything_starts() {
    let bench = Bench::new();
    let check = |text: &str| {
        bench.write("p.toml", text);
        bench.run(["check", "p.toml"])
    };
    check("mode = \"live").expect_error(CONFIGURATION, &["p.toml", "line 1"]);
    check("mode = \"slow\"").expect_error(CONFIGURATION, &["p.toml", "line 1", "lossless"]);
    check("").expect_error(CONFIGURATION, &["[[stage]]"]);
    check("[[stage]]\nkind = \"teleporter\"").expect_error(CONFIGURATION, &["teleporter", "octree_mapper"]);
    check("[[stage]]\nkind = \"lio\"").expect_error(CONFIGURATION, &["scan/deskewed", "no stage writes"]);
    check("[[stage]]\nkind = \"simulator\"\n[[stage]]\nkind = \"replay\"\nname = \"b\"\n[stage.config]\nbag = \"x.bag\"")
        .expect_error(CONFIGURATION, &["both write lidar/scan"]);
    check("[[stage]]\nkind = \"simulator\"\n[stage.config]\nsped = 1").expect_error(CONFIGURATION, &["sped"]);
    check("[[stage]]\nkind = \"simulator\"\nrun = [\"./nothing\"]")
        .expect_error(CONFIGURATION, &["./nothing"]);
    bench.run(["check", "nowhere.toml"]).expect_error(FILE, &["nowhere.toml"]);
    bench.run(["up", "nowhere.toml"]).expect_error(FILE, &["nowhere.toml"]);

    bench.write("rig.toml", "[rig.imu_from_lidar]\ntranslation = [0, 0, 0]\n");
    bench.write("walk.bag", "");
    bench.run(["map", "walk.bag", "--rig", "rig.toml"]).expect_error(CONFIGURATION, &["rig.toml", "line 2"]);
    bench.run(["demo", "--domain", "a/b"]).expect_error(CONFIGURATION, &["a/b"]);
    bench.run(["stage", "teleporter"]).expect_error(CONFIGURATION, &["teleporter"]);
}

#[test]
fn wrong_usage_ends_with_code_2_and_says_what_is_expected() {
    let bench = Bench::new();
    for args in [&["map"][..], &["demo", "--sed", "1"], &["nonsense"], &["convert", "x.pcd"]] {
        let ended = bench.run(args);
        assert_eq!(ended.code, USAGE, "{args:?}: {}", ended.stderr);
        assert!(ended.stderr.contains("Usage: evac"), "{}", ended.stderr);
    }
    for command in [
        "demo",
        "map",
        "up",
        "down",
        "status",
        "check",
        "stage",
        "convert",
        "eval",
        "calibrate",
        "experiment",
    ] {
        let help = bench.run([command, "--help"]).expect_success().stdout;
        assert!(help.contains("Usage: evac") && help.lines().count() > 8, "{help}");
    }
}

#[test]
fn every_stage_prints_a_configuration_that_it_accepts() {
    let bench = Bench::new();
    for kind in
        ["simulator", "replay", "deskewer", "lio", "loam", "octree_mapper", "grid_exporter", "map_saver"]
    {
        let printed = bench.run(["stage", kind, "--print-config"]);
        if kind == "replay" {
            // Without a recording there is nothing to replay.
            printed.expect_error(CONFIGURATION, &["bag", "lidar"]);
            continue;
        }
        let printed = printed.expect_success().stdout;
        bench.write("printed.toml", &printed);
        bench.run(["stage", kind, "--config", "printed.toml", "--check"]).expect_success();
    }
}
