//! `evac convert` on clouds of all formats, its filters and its flat map, and `evac experiment table2` on a small cloud.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use std::path::{Path, PathBuf};

use common::Bench;
use evac_formats::cloud::{CloudPoint, Intensity, Reader};
use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};
use evac_formats::pcd::{self, WriteAs};

/// Files that laspy and plyfile wrote.
fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("shared/formats/tests/golden_clouds").join(name)
}

fn write_cloud(path: &Path, points: &[[f32; 3]]) {
    let points: Vec<CloudPoint> =
        points.iter().map(|[x, y, z]| CloudPoint { x: *x, y: *y, z: *z, intensity: 0.0 }).collect();
    pcd::write(path, points.into_iter(), Intensity::Dropped, WriteAs::Binary).unwrap();
}

#[test]
fn the_same_points_give_the_same_tree_from_every_format() {
    let bench = Bench::new();
    let origin = ["--origin", "500000", "4000000", "0"];
    let laz = golden("laz_format6.laz");
    let points: Vec<[f32; 3]> = Reader::open(&laz, [500_000.0, 4_000_000.0, 0.0])
        .unwrap()
        .map(|point| point.map(|point| [point.x, point.y, point.z]).unwrap())
        .collect();
    write_cloud(&bench.path("cloud.pcd"), &points);
    bench.run(["convert", "cloud.pcd", "-r", "0.1", "-o", "pcd.ot"]).expect_success();
    for name in ["laz_format0.laz", "laz_format3.laz", "laz_format6.laz", "laz_format7.laz"] {
        let mut command = bench.evac(["convert"]);
        command.arg(golden(name)).args(origin).args(["-r", "0.1", "-o", "laz.ot"]);
        common::Running::start(command).end().expect_success();
        assert!(bench.bytes("laz.ot") == bench.bytes("pcd.ot"), "{name}");
    }
    let trees = ["plyfile_ascii.ply", "plyfile_le.ply", "plyfile_be.ply"].map(|name| {
        let mut command = bench.evac(["convert"]);
        command.arg(golden(name)).args(["-r", "0.1", "-o", "ply.ot"]);
        common::Running::start(command).end().expect_success();
        bench.bytes("ply.ot")
    });
    assert!(trees[0] == trees[1] && trees[1] == trees[2]);
}

#[test]
fn a_cloud_in_a_map_projection_is_refused_with_the_origin_to_take_off() {
    let bench = Bench::new();
    let mut command = bench.evac(["convert"]);
    command.arg(golden("laz_format6.laz")).args(["-r", "0.1", "-o", "map.bt"]);
    let ended = common::Running::start(command).end();
    ended.expect_error(1, &["305 points lie beyond", "--origin 500000 4000000"]);
}

#[test]
fn every_point_that_is_left_out_is_counted_by_its_reason() {
    let bench = Bench::new();
    let mut points: Vec<[f32; 3]> =
        (0..60).flat_map(|x| (0..40).map(move |y| [0.1 * x as f32, 0.1 * y as f32, 0.0])).collect();
    let floor = points.len();
    points.extend((0..20).map(|z| [2.05, 2.05, 0.15 + 0.1 * z as f32]));
    points.extend([[f32::NAN; 3], [3.0, 3.0, 9.0], [1.0, 1.0, 1.5], [4.0, 1.0, 1.5]]);
    write_cloud(&bench.path("cloud.pcd"), &points);
    let filters = ["--outlier-radius", "0.25", "--neighbours", "2", "--z", "-1", "5", "--remove-ground"];
    let outputs = ["-o", "map.ot", "-o", "centres.pcd", "-o", "binary.pcd"];
    let args = [["convert", "cloud.pcd", "-r", "0.1"].as_slice(), &filters, &outputs].concat();
    let said = bench.run(&args).expect_success().stdout;
    let counts = format!(
        "{} points in 4 passes: 1 not finite, 1 outside the limits, 0 beyond the keys, 2 outliers, {floor} ground removed, 20 in the map",
        points.len()
    );
    assert!(said.contains(&counts), "{said}");
    let centres: Vec<_> =
        Reader::open(&bench.path("centres.pcd"), [0.0; 3]).unwrap().map(Result::unwrap).collect();
    assert_eq!(centres.len(), 20);
    assert!(bench.text("centres.pcd").contains("DATA ascii"));
    let args = [["convert", "cloud.pcd", "-r", "0.1", "--binary"].as_slice(), &filters, &outputs].concat();
    bench.run(&args).expect_success();
    let binary: Vec<_> =
        Reader::open(&bench.path("centres.pcd"), [0.0; 3]).unwrap().map(Result::unwrap).collect();
    assert_eq!(binary, centres);
    assert!(bench.bytes("centres.pcd").windows(12).any(|part| part == b"DATA binary\n"));
}

/// A room of 6 x 4 m with a table, under a second one without.
fn two_storeys() -> Vec<[f32; 3]> {
    let mut points = Vec::new();
    for (x, y) in (0..120).flat_map(|x| (0..80).map(move |y| (0.05 * x as f32, 0.05 * y as f32))) {
        points.extend([[x, y, 0.02], [x, y, 2.7], [x, y, 3.02], [x, y, 5.7]]);
    }
    for (along, z) in (0..120).flat_map(|i| (0..50).map(move |z| (0.05 * i as f32, 0.05 * z as f32))) {
        for floor in [0.02, 3.02] {
            points.extend([[along, 0.0, floor + z], [along, 3.95, floor + z]]);
            points.extend(
                (along < 4.0)
                    .then_some([[0.0, along, floor + z], [5.95, along, floor + z]])
                    .into_iter()
                    .flatten(),
            );
        }
    }
    for (x, y) in (0..28).flat_map(|x| (0..16).map(move |y| (0.05 * x as f32, 0.05 * y as f32))) {
        points.push([2.0 + x, 1.5 + y, 0.75]);
    }
    points
}

fn at(grid: &OccupancyGrid, x: f64, y: f64) -> i8 {
    let [column, row] = [(x - grid.origin[0]) / grid.resolution, (y - grid.origin[1]) / grid.resolution];
    grid.cells[row as usize * grid.width as usize + column as usize]
}

#[test]
fn the_flat_map_shows_walls_free_floor_and_a_table_of_one_storey() {
    let bench = Bench::new();
    write_cloud(&bench.path("cloud.pcd"), &two_storeys());
    for (storey, table) in [("0", OCCUPIED), ("3", FREE)] {
        let args =
            ["convert", "cloud.pcd", "-r", "0.1", "--storey", storey, "-o", "plan.yaml", "-o", "plan.png"];
        bench.run(args).expect_success();
        let grid = evac_formats::occupancy_grid::read(&bench.path("plan.yaml")).unwrap();
        assert_eq!(at(&grid, 1.05, 1.05), FREE);
        assert_eq!(at(&grid, 4.55, 3.05), FREE);
        assert_eq!(at(&grid, 2.65, 1.85), table, "storey {storey}");
        assert_eq!(at(&grid, 0.05, 2.05), OCCUPIED);
        assert_eq!(at(&grid, 3.05, 3.95), OCCUPIED);
        assert!(bench.bytes("plan.png").starts_with(b"\x89PNG"));
    }
    // Ground that was not seen is unknown.
    let hole = |point: &[f32; 3]| !((4.0..5.0).contains(&point[0]) && (1.0..2.0).contains(&point[1]));
    let points: Vec<_> = two_storeys().into_iter().filter(|point| point[2] > 1.0 || hole(point)).collect();
    write_cloud(&bench.path("cloud.pcd"), &points);
    bench.run(["convert", "cloud.pcd", "-r", "0.1", "--storey", "0", "-o", "plan.pgm"]).expect_success();
    let grid = evac_formats::occupancy_grid::read(&bench.path("plan.yaml")).unwrap();
    assert_eq!(at(&grid, 4.55, 1.55), UNKNOWN);
}

#[test]
fn what_cannot_be_converted_is_named_with_a_remedy() {
    let bench = Bench::new();
    let cut = std::fs::read(golden("plyfile_le.ply")).unwrap();
    bench.write("cut.ply", &cut[..cut.len() - 3]);
    bench
        .run(["convert", "cut.ply", "-r", "0.1", "-o", "map.bt"])
        .expect_error(4, &["cut.ply: byte", "after 1 of 2"]);
    assert!(!bench.path("map.bt").exists());
    bench
        .run(["convert", "cut.ply", "-r", "0.1", "-o", "map.xyz"])
        .expect_error(3, &["map.xyz", ".bt", ".png"]);
    let args = ["convert", "cut.ply", "-r", "0.1", "--outlier-radius", "0", "-o", "map.bt"];
    bench.run(args).expect_error(3, &["radius = 0"]);
}

#[test]
fn table_2_has_six_conditions_whose_sizes_are_those_of_the_files() {
    let bench = Bench::new();
    write_cloud(&bench.path("cloud.pcd"), &two_storeys());
    bench.run(["experiment", "table2", "--cloud", "cloud.pcd", "-o", "out"]).expect_success();
    let whole: serde_json::Value = serde_json::from_str(&bench.text("out/table2.json")).unwrap();
    let conditions = whole["conditions"].as_array().unwrap();
    assert_eq!(conditions.len(), 6);
    for condition in conditions {
        let ground = if condition["ground_removed"] == true { "removed" } else { "kept" };
        let name = format!("out/ground-{ground}-{}", condition["resolution_m"]);
        for (key, kind) in [("bt_bytes", "bt"), ("ot_bytes", "ot"), ("pcd_bytes", "pcd")] {
            let bytes = bench.bytes(&format!("{name}.{kind}")).len();
            assert_eq!(condition[key], bytes, "{name}.{kind}");
        }
    }
    assert!(conditions[0]["points"].as_u64() < conditions[3]["points"].as_u64());
    assert!(bench.text("out/table2.md").contains("| 0.8 m, ground kept |"));
    assert!(bench.bytes("out/maps.png").starts_with(b"\x89PNG"));
}
