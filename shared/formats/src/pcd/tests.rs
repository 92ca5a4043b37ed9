use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::FormatError;
use crate::cloud::{CloudPoint, Intensity};

fn read_bytes(bytes: &[u8]) -> Result<Vec<CloudPoint>, FormatError> {
    Reader::new(bytes, Path::new("a.pcd"))?.collect()
}

fn header(fields: &str, sizes: &str, types: &str, counts: &str, points: usize, data: &str) -> Vec<u8> {
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\n\
        COUNT {counts}\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
    .into_bytes()
}

fn two_points() -> [CloudPoint; 2] {
    [
        CloudPoint { x: 1.0, y: -2.5, z: 0.1, intensity: 200.0 },
        CloudPoint { x: f32::MIN_POSITIVE, y: 1e7, z: -0.0, intensity: 0.0 },
    ]
}

fn written(points: &[CloudPoint], write_as: WriteAs) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_to(&mut bytes, points.iter().copied(), Intensity::Kept, write_as).unwrap();
    bytes
}

#[test]
fn clouds_come_back_from_both_written_forms() {
    for write_as in [WriteAs::Ascii, WriteAs::Binary] {
        let bytes = written(&two_points(), write_as);
        assert_eq!(read_bytes(&bytes).unwrap(), two_points());
    }
}

#[test]
fn golden_bytes_of_a_cloud_of_one_point() {
    let point = CloudPoint { x: 1.0, y: -2.0, z: f32::NAN, intensity: 9.0 };
    let mut ascii = Vec::new();
    write_to(&mut ascii, [point].into_iter(), Intensity::Dropped, WriteAs::Ascii).unwrap();
    let golden = [header("x y z", "4 4 4", "F F F", "1 1 1", 1, "ascii"), b"1 -2 nan\n".to_vec()].concat();
    assert_eq!(ascii, golden);
    assert!(!read_bytes(&ascii).unwrap()[0].is_finite());
}

#[test]
fn fields_of_any_order_type_and_count_are_found() {
    let mut bytes = header("t _ z y intensity x", "8 1 8 2 1 4", "U U F I U F", "1 3 1 1 1 1", 2, "binary");
    for (z, y, intensity, x) in [(0.5f64, -7i16, 250u8, 1.25f32), (-3.0, 300, 0, 9.0)] {
        bytes.extend(77u64.to_le_bytes());
        bytes.extend([1, 2, 3]);
        bytes.extend(z.to_le_bytes());
        bytes.extend(y.to_le_bytes());
        bytes.push(intensity);
        bytes.extend(x.to_le_bytes());
    }
    let points = read_bytes(&bytes).unwrap();
    assert_eq!(points[0], CloudPoint { x: 1.25, y: -7.0, z: 0.5, intensity: 250.0 });
    assert_eq!(points[1], CloudPoint { x: 9.0, y: 300.0, z: -3.0, intensity: 0.0 });

    let mut ascii = header("t _ z y intensity x", "8 1 8 2 1 4", "U U F I U F", "1 3 1 1 1 1", 1, "ascii");
    ascii.extend(b"77 1 2 3 0.5 -7 250 1.25\r\n\n");
    assert_eq!(read_bytes(&ascii).unwrap(), &points[..1]);
}

#[test]
fn a_compressed_cloud_is_unpacked_field_by_field() {
    let mut plain = Vec::new();
    for axis in [[1.0f32, 2.0], [3.0, 4.0], [5.0, 6.0]] {
        plain.extend(axis.iter().flat_map(|value| value.to_le_bytes()));
    }
    // Literally, in one run of 24 bytes.
    let packed = [&[23], plain.as_slice()].concat();
    let mut bytes = header("x y z", "4 4 4", "F F F", "1 1 1", 2, "binary_compressed");
    bytes.extend((packed.len() as u32).to_le_bytes());
    bytes.extend((plain.len() as u32).to_le_bytes());
    bytes.extend(packed);
    let points = read_bytes(&bytes).unwrap();
    assert_eq!(points[0], CloudPoint { x: 1.0, y: 3.0, z: 5.0, intensity: 0.0 });
    assert_eq!(points[1], CloudPoint { x: 2.0, y: 4.0, z: 6.0, intensity: 0.0 });
}

#[test]
fn a_cut_file_gives_its_points_and_then_one_error_with_the_place() {
    let bytes = written(&two_points(), WriteAs::Binary);
    let mut reader = Reader::new(&bytes[..bytes.len() - 1], Path::new("a.pcd")).unwrap();
    assert_eq!(reader.next().unwrap().unwrap(), two_points()[0]);
    let error = reader.next().unwrap().unwrap_err().to_string();
    assert!(
        error.contains(&format!("byte {}: the data end after 1 of 2 points", bytes.len() - 16)),
        "{error}"
    );
    assert!(reader.next().is_none());
}

#[test]
fn bad_headers_are_refused_with_their_cause() {
    let good = String::from_utf8(header("x y z", "4 4 4", "F F F", "1 1 1", 0, "ascii")).unwrap();
    assert_eq!(read_bytes(good.as_bytes()).unwrap(), []);
    for (from, to, word) in [
        ("x y z", "x y w", "no field \"z\""),
        ("x y z", "x y z z", "4 FIELDS but 3 SIZE"),
        ("4 4 4", "4 4 3", "SIZE 3"),
        ("F F F", "F F Q", "TYPE \"Q\""),
        ("1 1 1", "1 1 2", "COUNT 2"),
        ("1 1 1", "1 1 99999999999999999999", "whole number"),
        ("POINTS 0", "POINTS 5", "POINTS 5 is not WIDTH times HEIGHT"),
        ("ascii", "zip", "DATA \"zip\""),
        ("VERSION 0.7", "VERSION 8", "version"),
        ("HEIGHT 1", "HEIGHT -1", "whole number"),
        ("DATA ascii", "", "before the DATA line"),
        ("# .PCD", "PLY", "no keyword"),
    ] {
        let error = read_bytes(good.replacen(from, to, 1).as_bytes()).unwrap_err().to_string();
        assert!(error.contains(word) && error.starts_with("a.pcd: byte "), "{error}");
    }
    // A COUNT that would wrap round the size of a point.
    let wide = header("x y z _", "4 4 4 1", "F F F U", "1 1 1 18446744073709551615", 1, "binary");
    let error = read_bytes(&[wide, vec![0; 64]].concat()).unwrap_err().to_string();
    assert!(error.contains("more than 65536 bytes"), "{error}");
    let giant = header("x y z", "4 4 4", "F F F", "1 1 1", usize::MAX, "binary_compressed");
    let error = read_bytes(&[giant, vec![0xff; 8]].concat()).unwrap_err().to_string();
    assert!(error.contains("do not fit"), "{error}");
}

#[test]
fn an_ascii_cloud_with_more_lines_than_points_or_a_bad_word_is_refused() {
    let head = header("x y z", "4 4 4", "F F F", "1 1 1", 1, "ascii");
    for (body, word) in
        [("1 2 3\n4 5 6\n", "more lines"), ("1 2\n", "2 values"), ("1 2 z\n", "no number"), ("", "0 of 1")]
    {
        let error = read_bytes(&[head.as_slice(), body.as_bytes()].concat()).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn the_real_halls_clouds_are_read() {
    for (name, count) in [("corner", 63_381), ("surf", 91_531)] {
        let Some(path) = evac_testkit::data(&format!("real/livox_mid40_hall_map/{name}.pcd")) else { return };
        let points: Vec<_> = Reader::open(&path).unwrap().collect::<Result<_, _>>().unwrap();
        assert_eq!(points.len(), count);
        assert!(points.iter().all(|p| p.is_finite() && p.x.abs() < 300.0));
    }
}

proptest! {
    #[test]
    fn every_cloud_comes_back_bit_by_bit(values: Vec<[u32; 4]>, ascii: bool) {
        let points: Vec<_> = values.iter().map(|v| {
            let [x, y, z, intensity] = v.map(f32::from_bits);
            CloudPoint { x, y, z, intensity }
        }).collect();
        let write_as = if ascii { WriteAs::Ascii } else { WriteAs::Binary };
        let back = read_bytes(&written(&points, write_as)).unwrap();
        prop_assert_eq!(back.len(), points.len());
        for (a, b) in points.iter().zip(&back) {
            for (a, b) in [(a.x, b.x), (a.y, b.y), (a.z, b.z), (a.intensity, b.intensity)] {
                prop_assert!(a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan());
            }
        }
    }

    #[test]
    fn headers_of_extreme_numbers_never_panic(
        sizes in prop::sample::select(vec!["1 2 4", "8 8 8", "1 1 1", "4 0 4", "4 18446744073709551615 1"]),
        numbers in proptest::collection::vec(
            prop::sample::select(vec![0_u64, 1, 2, 5, 65_536, 1 << 32, 1 << 61, 1 << 63, u64::MAX - 3, u64::MAX]), 5),
        encoding in prop::sample::select(vec!["ascii", "binary", "binary_compressed"]),
        body in proptest::collection::vec(any::<u8>(), 0..80),
    ) {
        let [a, b, c, width, height] = numbers[..] else { unreachable!() };
        let points = width.wrapping_mul(height);
        let head = format!(
            "FIELDS a b c x y z\nSIZE {sizes} 4 4 4\nTYPE U U I F F F\nCOUNT {a} {b} {c} 1 1 1\n\
            WIDTH {width}\nHEIGHT {height}\nPOINTS {points}\nDATA {encoding}\n"
        );
        if let Ok(reader) = Reader::new([head.as_bytes(), &body].concat().as_slice(), Path::new("a.pcd")) {
            prop_assert!(reader.take(1000).filter(Result::is_err).count() <= 1);
        }
    }

    #[test]
    fn mutated_and_cut_files_never_panic(
        form in 0..3usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        cut: prop::sample::Index,
    ) {
        let mut bytes = match form {
            0 => written(&two_points(), WriteAs::Ascii),
            1 => written(&two_points(), WriteAs::Binary),
            _ => {
                let mut bytes = header("x y z", "4 4 4", "F F F", "1 1 1", 2, "binary_compressed");
                bytes.extend([10, 0, 0, 0, 24, 0, 0, 0, 1, 9, 9, 4 << 5, 1, 7 << 5, 5, 0, 0, 3]);
                bytes
            }
        };
        for (at, value) in changes {
            *at.get_mut(&mut bytes) = value;
        }
        let cut = cut.index(bytes.len() + 1);
        // A changed POINTS may announce many points; the reader must end with the data.
        let _ = read_bytes(&bytes[..cut]);
    }
}
