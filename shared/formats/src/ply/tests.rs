use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::FormatError;
use crate::cloud::{CloudPoint, Intensity};

fn read(bytes: &[u8]) -> Result<Vec<CloudPoint>, FormatError> {
    Reader::new(bytes, Path::new("hall.ply"))?.collect()
}

fn point(x: f32, y: f32, z: f32, intensity: f32) -> CloudPoint {
    CloudPoint { x, y, z, intensity }
}

/// Two vertices with colours, doubles and a list, after an element of another name.
fn rich(format: &str) -> Vec<u8> {
    let header = format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement camera 1\nproperty list uchar short pose\n\
        element vertex 2\nproperty double x\nproperty double y\nproperty float z\nproperty uchar red\n\
        property list uint8 int32 seen_by\nproperty ushort scalar_Intensity\nelement face 0\n\
        property list uchar int vertex_indices\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    if format == "ascii" {
        bytes.extend(b"2 7 8\n\n0.5 -1 2.5 255 3 1 2 3 77\n1e1 4 -8 0 0 65535\n");
        return bytes;
    }
    let big = format == "binary_big_endian";
    let mut put = |le: &[u8]| {
        if big {
            bytes.extend(le.iter().rev());
        } else {
            bytes.extend(le);
        }
    };
    put(&[2]);
    put(&7i16.to_le_bytes());
    put(&8i16.to_le_bytes());
    for (x, y, z, red, list, intensity) in
        [(0.5f64, -1.0f64, 2.5f32, 255u8, &[1i32, 2, 3][..], 77u16), (10.0, 4.0, -8.0, 0, &[], 65_535)]
    {
        put(&x.to_le_bytes());
        put(&y.to_le_bytes());
        put(&z.to_le_bytes());
        put(&[red]);
        put(&[list.len() as u8]);
        list.iter().for_each(|value| put(&value.to_le_bytes()));
        put(&intensity.to_le_bytes());
    }
    bytes
}

#[test]
fn all_three_encodings_give_the_same_vertices_whatever_lies_between() {
    let expected = [point(0.5, -1.0, 2.5, 77.0), point(10.0, 4.0, -8.0, 65_535.0)];
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        assert_eq!(read(&rich(format)).unwrap(), expected, "{format}");
    }
}

#[test]
fn what_is_written_comes_back() {
    let points = [point(1.0, -2.0, 0.5, 7.0), point(f32::NAN, 0.0, 0.0, 0.0)];
    let mut bytes = Vec::new();
    write_to(&mut bytes, points.into_iter(), Intensity::Kept).unwrap();
    let back = read(&bytes).unwrap();
    assert_eq!(back[0], points[0]);
    assert!(back[1].x.is_nan() && back.len() == 2);
}

#[test]
fn an_origin_is_taken_off_before_digits_are_lost() {
    let text = "ply\r\nformat ascii 1.0\r\nelement vertex 1\r\nproperty double x\r\nproperty double y\r\n\
        property double z\r\nend_header\r\n500000.125 4000000.0625 10\r\n";
    let reader = Reader::new(text.as_bytes(), Path::new("a.ply")).unwrap();
    let points: Vec<_> = reader.with_origin([500_000.0, 4_000_000.0, 0.0]).map(Result::unwrap).collect();
    assert_eq!(points, [point(0.125, 0.0625, 10.0, 0.0)]);
}

#[test]
fn each_fault_is_named_with_its_place() {
    let vertex =
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
    let cases = [
        ("PLY\n".to_owned(), "begins with \"ply\""),
        ("ply\nformat ascii 2.0\n".to_owned(), "version \"2.0\""),
        ("ply\nformat text 1.0\n".to_owned(), "\"text\""),
        ("ply\nend_header\n".to_owned(), "no format line"),
        ("ply\nformat ascii 1.0\nend_header\n".to_owned(), "no element \"vertex\""),
        ("ply\nformat ascii 1.0\nelement vertex many\n".to_owned(), "\"many\""),
        ("ply\nformat ascii 1.0\nproperty float x\n".to_owned(), "before the first element"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\n".to_owned(), "\"half\""),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n".to_owned(),
            "no x, y and z",
        ),
        (format!("{vertex}end_header\n1 2 3\n"), "after 1 of 2 vertices"),
        (format!("{vertex}end_header\n1 2 x\n"), "\"x\" for property \"z\""),
        (format!("{vertex}end_header\n1 2\n"), "no value for property \"z\""),
        (format!("{vertex}end_header\n1 2 3 4\n"), "\"4\" behind"),
        (vertex.to_owned(), "no end_header"),
    ];
    for (text, part) in cases {
        let message = read(text.as_bytes()).unwrap_err().to_string();
        assert!(
            message.contains(part) && message.starts_with("hall.ply: byte "),
            "{message:?} lacks {part:?}"
        );
    }
    let mut cut = rich("binary_big_endian");
    cut.pop();
    assert!(read(&cut).unwrap_err().to_string().contains("after 1 of 2 vertices"));
}

#[test]
fn a_header_that_announces_more_than_there_is_takes_no_memory_for_it() {
    let header = "ply\nformat binary_little_endian 1.0\nelement nothing 18446744073709551615\nelement list 1\n\
        property list uint double all\nelement vertex 18446744073709551615\nproperty float x\nproperty float y\n\
        property float z\nend_header\n";
    let bytes = [header.as_bytes(), &u32::MAX.to_le_bytes(), &[0; 64]].concat();
    assert!(read(&bytes).unwrap_err().to_string().contains("the data end"));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn mutated_files_never_panic(
        format in proptest::sample::select(vec!["ascii", "binary_little_endian", "binary_big_endian"]),
        edits in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 0..6),
        cut in any::<proptest::sample::Index>(),
    ) {
        let mut bytes = rich(format);
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate(cut.index(bytes.len() + 1));
        let _ = read(&bytes);
    }
}
