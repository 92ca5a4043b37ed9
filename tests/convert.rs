//! `evac convert` on real and large clouds, checked by OctoMap's own tools.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::path::Path;

use common::{Bench, other_program};

/// Debian's octomap-tools read the file and find the same tree; skips with a printed line where they are not installed.
fn assert_octomap_reads(bench: &Bench, file: &Path) {
    let back = bench.path("back.ot");
    let Some(output) = other_program("convert_octree", &[file, &back]) else { return };
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(back.exists(), "{}: {said}", file.display());
    let (ours, theirs) =
        (evac_formats::octomap::read(file).unwrap(), evac_formats::octomap::read(&back).unwrap());
    assert_eq!(ours.nodes(), theirs.nodes(), "{}", file.display());
    std::fs::remove_file(back).unwrap();
}

fn convert(cloud: &Path, ground: bool) {
    let bench = Bench::new();
    for name in ["map.bt", "map.ot"] {
        let mut command = bench.evac(["convert"]);
        command.arg(cloud).args(["--resolution", "0.2", "-o", name]);
        if ground {
            command.arg("--remove-ground");
        }
        let ended = common::Running::start(command).end().expect_success();
        println!("{}", ended.stdout.trim());
        assert_octomap_reads(&bench, &bench.path(name));
    }
}

#[test]
fn a_small_cloud_becomes_the_tree_that_its_points_say() {
    let bench = Bench::new();
    let header =
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\nHEIGHT 1\nPOINTS 3\n";
    bench.write("cloud.pcd", format!("{header}DATA ascii\n0.05 0.05 0.05\n0.05 0.05 0.05\n1.0 -2.0 0.3\n"));
    bench.run(["convert", "cloud.pcd", "--resolution", "0.1", "-o", "map.ot"]).expect_success();
    let tree = evac_formats::octomap::read(&bench.path("map.ot")).unwrap();
    assert_eq!(tree.resolution(), 0.1);
    let leaves: Vec<_> =
        tree.nodes().iter().filter(|node| node.child_mask == 0).map(|node| node.log_odds).collect();
    // One hit is 0.847, two are 1.695 (float32, as OctoMap adds them).
    assert_eq!(leaves.len(), 2);
    assert!(leaves.contains(&0.847_297_85) && leaves.contains(&1.694_595_7), "{leaves:?}");
    assert_octomap_reads(&bench, &bench.path("map.ot"));
}

#[test]
fn the_real_mid40_hall_converts_and_octomap_reads_it() {
    for cloud in ["corner.pcd", "surf.pcd"] {
        let Some(cloud) = evac_testkit::data(&format!("real/livox_mid40_hall_map/{cloud}")) else { return };
        convert(&cloud, false);
        convert(&cloud, true);
    }
}

#[test]
fn the_station_cloud_converts_and_octomap_reads_it() {
    let Some(packed) = evac_testkit::data("simulated/station/station.pcd.xz") else { return };
    let bench = Bench::new();
    let cloud = bench.path("station.pcd");
    let unpacked = std::process::Command::new("xz")
        .arg("-dc")
        .arg(packed)
        .stdout(std::fs::File::create(&cloud).unwrap())
        .status();
    match unpacked {
        Ok(status) => assert!(status.success()),
        Err(cause) => return println!("skipped: xz: {cause}"),
    }
    convert(&cloud, false);
    convert(&cloud, true);
}
