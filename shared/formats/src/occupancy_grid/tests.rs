use std::fs;
use std::path::Path;

use proptest::prelude::*;

use super::yaml::Keys;
use super::*;

/// 3 x 2 cells: lower row occupied, free, unknown; upper row free, unknown, occupied.
fn small() -> OccupancyGrid {
    OccupancyGrid {
        width: 3,
        height: 2,
        resolution: 0.05,
        origin: [-123.456_789, 7.0, 0.0],
        cells: vec![OCCUPIED, FREE, UNKNOWN, FREE, UNKNOWN, OCCUPIED],
    }
}

fn with_yaml(text: &str) -> Result<OccupancyGrid, crate::FormatError> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.pgm"), b"P5\n# c\n3 1\n255\n\x00\xcd\xfe").unwrap();
    let path = folder.path().join("a.yaml");
    fs::write(&path, text).unwrap();
    read(&path)
}

#[test]
fn golden_bytes_of_a_small_map() {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join("plan.yaml"), &small()).unwrap();
    let picture = fs::read(folder.path().join("plan.pgm")).unwrap();
    // The picture's first row is the highest y.
    assert_eq!(picture, b"P5\n# CREATOR: evac 0.050 m/pix\n3 2\n255\n\xfe\xcd\x00\x00\xfe\xcd");
    let yaml = fs::read_to_string(folder.path().join("plan.yaml")).unwrap();
    let golden = "image: plan.pgm\nmode: trinary\nresolution: 0.05\norigin: [-123.456789, 7.0, 0.0]\n\
        negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";
    assert_eq!(yaml, golden);
}

#[test]
fn unknown_stays_unknown_and_the_origin_exact_through_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.yaml");
    write(&path, &small()).unwrap();
    assert_eq!(read(&path).unwrap(), small());
}

#[test]
fn unknown_would_become_free_with_the_default_threshold_of_nav2() {
    let head = "image: a.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n";
    assert_eq!(with_yaml(head).unwrap().cells, [OCCUPIED, FREE, FREE]);
    let ours = with_yaml(&format!("{head}free_thresh: 0.196\n")).unwrap();
    assert_eq!(ours.cells, [OCCUPIED, UNKNOWN, FREE]);
}

#[test]
fn values_between_the_thresholds_are_saved_as_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.yaml");
    let mut grid = small();
    grid.cells = vec![20, 21, 64, 65, 101, 100];
    write(&path, &grid).unwrap();
    assert_eq!(read(&path).unwrap().cells, [FREE, UNKNOWN, UNKNOWN, OCCUPIED, UNKNOWN, OCCUPIED]);
}

#[test]
fn files_of_other_savers_are_read() {
    let dashes = "# saved\nimage: 'a.pgm'\nresolution: 0.1 # m\norigin:\n- -1.5\n- 2\n- 0.0\nnegate: 1\n\
        occupied_thresh: 0.65\nfree_thresh: 0.1\nmode: trinary\n";
    let grid = with_yaml(dashes).unwrap();
    assert_eq!(grid.origin, [-1.5, 2.0, 0.0]);
    assert_eq!(grid.cells, [FREE, OCCUPIED, OCCUPIED]);
    let head = "image: \"a.pgm\"\nresolution: 1e-1\norigin: [0, 0, 0]\n";
    assert_eq!(with_yaml(&format!("{head}mode: raw\n")).unwrap().cells, [0, UNKNOWN, UNKNOWN]);
    let scale = with_yaml(&format!("{head}mode: scale\nfree_thresh: 0.0\noccupied_thresh: 1.0\n")).unwrap();
    assert_eq!(scale.cells, [100, 20, 0]);
}

#[test]
fn a_map_file_that_names_a_spare_picture_keeps_it_until_the_next_one_is_there_and_none_is_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.yaml");
    write(&path, &small()).unwrap();
    // As after a kill in the middle.
    fs::rename(folder.path().join("plan.pgm"), folder.path().join("plan.new.pgm")).unwrap();
    let text = fs::read_to_string(&path).unwrap().replace("plan.pgm", "plan.new.pgm");
    fs::write(&path, text).unwrap();
    assert_eq!(read(&path).unwrap(), small());
    let other = OccupancyGrid { origin: [1.0, 2.0, 0.0], ..small() };
    write(&path, &other).unwrap();
    assert_eq!(read(&path).unwrap(), other);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn bad_map_files_are_refused_by_name_and_place() {
    let good = "image: a.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n";
    for (text, word) in [
        ("", "no \"resolution\""),
        ("image: a.pgm\nresolution: 0\norigin: [0, 0, 0]\n", "byte 13"),
        ("image: a.pgm\nresolution: .nan\norigin: [0, 0, 0]\n", "number is needed"),
        ("image: a.pgm\nresolution: 0.1\norigin: [0, 0]\n", "2 values where 3"),
        ("resolution: 0.1\norigin: [0, 0, 0]\n", "no \"image\""),
        ("image: b.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n", "check the path"),
        (&format!("{good}mode: dual\n"), "mode \"dual\""),
        (&format!("{good}free_thresh: 0.7\n"), "free_thresh 0.7"),
        (&format!("{good}image: a.pgm\n"), "appears twice"),
        (&format!("{good}nonsense\n"), "no `key: value`"),
        (&format!("{good}x: &anchor 1\n"), "beyond the plain YAML"),
    ] {
        let error = with_yaml(text).unwrap_err().to_string();
        assert!(
            error.contains(word) && error.contains(".yaml") || error.contains("b.pgm"),
            "{text:?}: {error}"
        );
    }
}

#[test]
fn bad_pictures_are_refused() {
    for (bytes, word) in [
        (b"".as_slice(), "start with P5"),
        (b"P2\n1 1\n255\n0", "start with P5"),
        (b"P5\n3 2\n255\n\x00", "1 of 3 x 2 pixels"),
        (b"P5\n3 2\n65535\n\x00", "65535 where 1 to 255"),
        (b"P5\n0 2\n255\n\x00", "0 x 2"),
        (b"P5\n# no end", "no width"),
        (b"P5\n4294967295 4294967295\n255\n\x00", "of 4294967295 x"),
        (b"P5\n99999999999 1\n255\n\x00", "no width"),
    ] {
        let Err(error) = image::parse(bytes, Path::new("a.pgm")) else { panic!("{bytes:?} was accepted") };
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn a_grid_whose_cells_do_not_fit_its_size_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let mut grid = small();
    grid.width = 4;
    assert!(write(&folder.path().join("plan.yaml"), &grid).unwrap_err().to_string().contains("4 x 2"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

proptest! {
    #[test]
    fn every_value_comes_back_in_raw_and_in_scale_mode(
        cells in proptest::collection::vec(-1i8..=100, 12),
    ) {
        let grid = OccupancyGrid { width: 4, height: 3, cells, ..small() };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.yaml");
        for mode in [Mode::Raw, Mode::Scale] {
            write_as(&path, &grid, mode, &["a comment"]).unwrap();
            prop_assert_eq!(&read(&path).unwrap(), &grid, "{:?}", mode);
        }
    }

    #[test]
    fn every_trinary_grid_comes_back(
        width in 1u32..20,
        height in 1u32..20,
        seed in proptest::collection::vec(prop_oneof![Just(UNKNOWN), Just(FREE), Just(OCCUPIED)], 400),
        origin in [-1e4..1e4, -1e4..1e4, -3.2..3.2],
        resolution in 1e-3..10.0,
    ) {
        let cells = seed[..(width * height) as usize].to_vec();
        let grid = OccupancyGrid { width, height, resolution, origin, cells };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.yaml");
        write(&path, &grid).unwrap();
        prop_assert_eq!(read(&path).unwrap(), grid);
    }

    #[test]
    fn no_bytes_make_the_picture_reader_panic(
        mut bytes in proptest::collection::vec(any::<u8>(), 0..60),
        header in prop_oneof![Just(&b"P5"[..]), Just(&b"P5 3 2 255\n"[..]), Just(&b""[..])],
    ) {
        bytes.splice(0..0, header.iter().copied());
        let _ = image::parse(&bytes, Path::new("a.pgm"));
    }

    #[test]
    fn mutated_and_cut_map_files_never_panic(
        in_picture: bool,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        cut: prop::sample::Index,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.yaml");
        write(&path, &small()).unwrap();
        let changed = if in_picture { folder.path().join("plan.pgm") } else { path.clone() };
        let mut bytes = fs::read(&changed).unwrap();
        for (at, value) in changes {
            *at.get_mut(&mut bytes) = value;
        }
        fs::write(&changed, &bytes[..cut.index(bytes.len() + 1)]).unwrap();
        if let Ok(grid) = read(&path) {
            prop_assert_eq!(grid.cells.len(), grid.width as usize * grid.height as usize);
        }
    }

    #[test]
    fn no_text_makes_the_yaml_reader_panic(text in "([a-z]{0,5}[:#\\[\\],'\"\\- \n]{0,3}){0,40}|\\PC{0,100}") {
        if let Ok(keys) = Keys::parse(text.as_bytes(), Path::new("a.yaml")) {
            let _ = (keys.three("a"), keys.number("b"));
        }
    }
}
