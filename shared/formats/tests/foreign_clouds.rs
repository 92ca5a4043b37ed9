//! Clouds that other people's tools wrote (plyfile 1.1; for LAS and LAZ see `src/las/tests.rs`), read from files.

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use evac_formats::cloud::{CloudPoint, Reader};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden_clouds").join(name)
}

#[test]
fn plyfile_s_ascii_and_binary_of_both_byte_orders_hold_the_same_points() {
    let expected = [
        CloudPoint { x: 0.5, y: -1.0, z: 2.5, intensity: 7.0 },
        CloudPoint { x: 10.0, y: 4.0, z: -8.0, intensity: 9.0 },
    ];
    for name in ["plyfile_ascii.ply", "plyfile_le.ply", "plyfile_be.ply"] {
        let reader = Reader::open(&golden(name), [0.0; 3]).unwrap();
        assert_eq!(reader.points(), 2);
        assert_eq!(reader.map(Result::unwrap).collect::<Vec<_>>(), expected, "{name}");
    }
}

#[test]
fn one_reader_opens_every_kind_by_its_contents() {
    let reader = Reader::open(&golden("laz_format7.laz"), [500_000.0, 4_000_000.0, 0.0]).unwrap();
    assert_eq!(reader.points(), 305);
    let first = reader.map(Result::unwrap).next().unwrap();
    assert_eq!([first.x, first.y, first.z], [0.125, 0.25, 10.5]);
    let missing = Reader::open(Path::new("no/such.laz"), [0.0; 3]).err().unwrap().to_string();
    assert!(missing.contains("no/such.laz") && missing.contains("check the path"), "{missing}");
}
