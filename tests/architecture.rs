//! Dependencies point one way.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::Value;

/// Own crates that each group of crates may depend on (not counting dev-dependencies).
fn allowed(name: &str) -> &'static [&'static str] {
    match name {
        "evac-frames" | "evac-clock" | "evac-testkit" => &[],
        "evac-geometry" => &["evac-frames"],
        "evac-formats" => &["evac-geometry"],
        "evac-evaluation" => &["evac-geometry", "evac-formats"],
        "evac-picture" => &["evac-formats"],
        "evac-octree" => &["evac-frames", "evac-formats"],
        "evac-config" => &["evac-geometry"],
        "evac-ports" => &["evac-frames"],
        "evac-stage" => &["evac-config", "evac-frames", "evac-ports"],
        "evac-deskewer" | "evac-odometry" => &["evac-frames", "evac-geometry", "evac-stage"],
        "evac-octree-mapper" => &["evac-frames", "evac-geometry", "evac-octree", "evac-stage"],
        "evac-simulator" | "evac-replay" | "evac-map-saver" | "evac-recorder" => {
            &["evac-frames", "evac-geometry", "evac-octree", "evac-formats", "evac-stage"]
        }
        "evac-lidar" => &["evac-clock", "evac-formats", "evac-frames", "evac-stage"],
        "evac-imu" => &["evac-clock", "evac-formats", "evac-frames", "evac-geometry", "evac-stage"],
        "evac-experiments" => &[
            "evac-config",
            "evac-deskewer",
            "evac-evaluation",
            "evac-formats",
            "evac-frames",
            "evac-geometry",
            "evac-odometry",
            "evac-replay",
            "evac-simulator",
            "evac-stage",
        ],
        "evac-calibration" => &[
            "evac-config",
            "evac-experiments",
            "evac-frames",
            "evac-geometry",
            "evac-odometry",
            "evac-stage",
        ],
        "evac-octomap-bench" => {
            &["evac-formats", "evac-frames", "evac-geometry", "evac-octree", "evac-simulator", "evac-stage"]
        }
        "evac-grid-exporter" => {
            &["evac-frames", "evac-geometry", "evac-octree", "evac-formats", "evac-picture", "evac-stage"]
        }
        other => unreachable!("{other} is new: say here what it may depend on"),
    }
}

#[test]
fn dependencies_point_one_way_and_only_ports_names_the_middleware() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo metadata runs");
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let mut seen = BTreeMap::new();
    for package in metadata["packages"].as_array().unwrap() {
        let name = package["name"].as_str().unwrap();
        let normal = package["dependencies"].as_array().unwrap().iter().filter(|d| d["kind"].is_null());
        let names: Vec<_> = normal.map(|d| d["name"].as_str().unwrap().to_owned()).collect();
        assert_eq!(names.iter().any(|d| d == "iceoryx2"), name == "evac-ports", "{name}");
        for dependency in
            package["dependencies"].as_array().unwrap().iter().filter(|d| d["name"] == "iceoryx2")
        {
            let version = dependency["req"].as_str().unwrap().trim_start_matches('=');
            assert_eq!(evac_ports::MIDDLEWARE, format!("iceoryx2 {version}"));
        }
        seen.insert(name.to_owned(), names);
    }
    assert!(seen.len() >= 14);
    for (name, dependencies) in seen.iter().filter(|(name, _)| *name != "evac") {
        for dependency in dependencies.iter().filter(|d| d.starts_with("evac")) {
            assert!(allowed(name).contains(&dependency.as_str()), "{name} may not depend on {dependency}");
        }
    }
}
