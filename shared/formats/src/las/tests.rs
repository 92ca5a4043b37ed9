use std::io::Cursor;
use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::FormatError;
use crate::cloud::CloudPoint;

/// Files that laspy 2.7 with lazrs wrote: five points, and in those of LAZ but one a spiral of 300 more.
const PLAIN: &[u8] = include_bytes!("../../tests/golden_clouds/las12_format0.las");
const EXTRA: &[u8] = include_bytes!("../../tests/golden_clouds/las14_extra.las");
const PACKED: [&[u8]; 4] = [
    include_bytes!("../../tests/golden_clouds/laz_format0.laz"),
    include_bytes!("../../tests/golden_clouds/laz_format3.laz"),
    include_bytes!("../../tests/golden_clouds/laz_format6.laz"),
    include_bytes!("../../tests/golden_clouds/laz_format7.laz"),
];
const PACKED_EXTRA: &[u8] = include_bytes!("../../tests/golden_clouds/laz_extra.laz");
const ORIGIN: [f64; 3] = [500_000.0, 4_000_000.0, 0.0];

fn reader(bytes: &[u8]) -> Result<Reader<Cursor<Vec<u8>>>, FormatError> {
    Reader::new(Cursor::new(bytes.to_vec()), Path::new("hall.las"))
}

fn read(bytes: &[u8]) -> Result<Vec<CloudPoint>, FormatError> {
    // A damaged header may announce 2^64 points of a compressed file.
    reader(bytes)?.with_origin(ORIGIN).take(10_000).collect()
}

fn expected() -> Vec<[f64; 3]> {
    let first =
        [[0.125, 0.25, 10.5], [1.0, 2.0, -3.25], [-0.5, -0.25, 0.0], [10.0, 10.0, 2.0], [0.0, 0.0, 1.0]];
    let spiral = (0..300).map(f64::from).map(|i| {
        let (sin, cos) = (0.1 * i).sin_cos();
        [0.01 * i * cos, 0.01 * i * sin, 0.005 * i]
    });
    first.into_iter().chain(spiral).collect()
}

#[track_caller]
fn assert_golden(bytes: &[u8], count: usize) {
    let points = read(bytes).unwrap();
    assert_eq!(points.len(), count);
    for (i, (point, expected)) in points.iter().zip(expected()).enumerate() {
        let close = |a: f32, b: f64| (f64::from(a) - b).abs() <= 0.000_501;
        let [x, y, z] = expected;
        assert!(close(point.x, x) && close(point.y, y) && close(point.z, z), "{i}: {point:?}");
        assert_eq!(point.intensity, (7 * i) as f32);
    }
}

#[test]
fn plain_files_of_another_tool_are_read() {
    assert_golden(PLAIN, 5);
    assert_golden(EXTRA, 5);
    let header = reader(EXTRA).unwrap().header().clone();
    assert_eq!((header.version, header.format, header.record, header.points), ([1, 4], 6, 34, 5));
}

#[test]
fn compressed_files_of_another_tool_are_read_in_old_and_new_formats() {
    for bytes in PACKED {
        assert_golden(bytes, 305);
    }
    assert_golden(PACKED_EXTRA, 5);
}

/// A file with some bytes replaced.
fn edited(file: &[u8], at: usize, bytes: &[u8]) -> Vec<u8> {
    [&file[..at], bytes, &file[at + bytes.len()..]].concat()
}

#[test]
fn each_fault_is_named_with_its_place_and_a_remedy() {
    let cases: Vec<(Vec<u8>, &str)> = vec![
        (b"LASX".to_vec(), "does not begin with LASF"),
        (PLAIN[..200].to_vec(), "byte 200: the file ends inside its header"),
        (edited(PLAIN, 24, &[2]), "version 2.2"),
        (edited(PLAIN, 94, &100u16.to_le_bytes()), "a header of 100 bytes where version 1.2 has 227"),
        (edited(EXTRA, 94, &227u16.to_le_bytes()), "a header of 227 bytes where version 1.4 has 375"),
        (edited(PLAIN, 104, &[11]), "point format 11"),
        (edited(PLAIN, 105, &19u16.to_le_bytes()), "points of 19 bytes where format 0 has 20"),
        (edited(PLAIN, 131, &0f64.to_le_bytes()), "give no coordinates"),
        (edited(PLAIN, 155, &f64::NAN.to_le_bytes()), "give no coordinates"),
        (edited(PLAIN, 96, &9999u32.to_le_bytes()), "points at byte 9999"),
        (edited(PLAIN, 107, &6u32.to_le_bytes()), "6 points are announced, 5 are there"),
        (edited(EXTRA, 247, &u64::MAX.to_le_bytes()), "18446744073709551615 points are announced"),
        (edited(PLAIN, 104, &[0x80]), "\"laszip encoded\" is missing"),
        (edited(PACKED[0], 104, &[0x81]), "points of 20 bytes where format 1 has 28"),
        (edited(PACKED[1], 104, &[0x86]), "its compressed points are not of format 6"),
        (PACKED[2][..PACKED[2].len() / 2].to_vec(), "after 0 of 305 points: a chunk at byte"),
        (edited(PACKED[0], 107, &400u32.to_le_bytes()), "of 400 points"),
    ];
    for (bytes, part) in cases {
        let message = read(&bytes).map(|points| points.len()).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("; "), "{message:?} lacks {part:?}");
        assert!(message.starts_with("hall.las: byte "), "{message}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn mutated_files_give_points_or_an_error(
        kind in 0usize..6,
        edits in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 0..6),
        cut in any::<proptest::sample::Index>(),
        cuts: bool,
    ) {
        let files = [PACKED[0], PACKED[1], PACKED[2], PACKED[3], PLAIN, EXTRA];
        let mut bytes = files[kind].to_vec();
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if cuts {
            bytes.truncate(cut.index(bytes.len() + 1));
        }
        let _ = read(&bytes);
    }
}

#[test]
fn gps_times_of_interleaved_sequences_do_not_put_the_coordinates_out_of_step() {
    // laspy wrote the same 700 points twice: four sequences of times with jumps, repeats and steps of all multiples.
    let [plain, packed] = [
        &include_bytes!("../../tests/golden_clouds/wild_times.las")[..],
        &include_bytes!("../../tests/golden_clouds/wild_times.laz")[..],
    ]
    .map(|bytes| read(bytes).unwrap());
    assert_eq!(plain.len(), 700);
    assert!(plain == packed);
}

#[test]
fn gps_times_that_change_their_sequence_without_end_are_damage() {
    // Found by fuzzing: crate `laz` recursed on it until the stack was full.
    let error = read(include_bytes!("../../tests/golden_clouds/laz_endless_times.laz")).unwrap_err();
    assert!(error.to_string().contains("without end"), "{error}");
}
