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
    let Some(cloud) = evac_testkit::unpacked("simulated/station/station.pcd") else { return };
    convert(&cloud, false);
    convert(&cloud, true);
}

/// A cloud that needs no data: 20,000 points on walls and floors, some of them several times.
fn generated_cloud() -> Vec<u8> {
    let mut state = 12_345_u32;
    let mut next = move |range: f32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32 * range
    };
    let points = 20_000;
    let mut cloud = format!(
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {points}\nHEIGHT 1\nPOINTS {points}\nDATA binary\n"
    )
    .into_bytes();
    for i in 0..points {
        let point = match i % 4 {
            0 => [next(20.0) - 10.0, next(8.0), 0.0],
            1 => [next(20.0) - 10.0, 8.0, next(3.0)],
            2 => [-10.0, next(8.0), next(3.0)],
            _ => [next(0.5), next(0.5), next(0.5)],
        };
        cloud.extend(point.iter().flat_map(|value: &f32| value.to_le_bytes()));
    }
    cloud
}

fn fnv(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Hashes of what OctoMap 1.9.7 (Debian's liboctomap) wrote for the same points: `updateNode(point, true)` for each in
/// order, then `write()` and `writeBinary()`.
const OCTOMAP_WROTE: [(&str, u64, u64); 3] = [
    ("0.05", 0x1b5f_ea18_2dfc_97a3, 0x180f_f249_a562_312c),
    ("0.1", 0xf713_436b_d12b_8abb, 0x813f_54dc_798b_a02c),
    ("0.4", 0x0ef5_239d_b243_a930, 0xc867_5118_7235_f9d5),
];

#[test]
fn a_cloud_becomes_the_file_that_octomap_writes_byte_for_byte() {
    let bench = Bench::new();
    bench.write("cloud.pcd", generated_cloud());
    for (resolution, full, binary) in OCTOMAP_WROTE {
        for (name, hash) in [("map.ot", full), ("map.bt", binary)] {
            bench.run(["convert", "cloud.pcd", "--resolution", resolution, "-o", name]).expect_success();
            assert_eq!(fnv(&bench.bytes(name)), hash, "{name} at {resolution} m");
        }
    }
}
