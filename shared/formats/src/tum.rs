//! TUM trajectories: `seconds tx ty tz qx qy qz qw` a line, `#` starts a comment.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;

use crate::lines::Lines;
use crate::{FormatError, write_atomically};

/// How far a quaternion's norm may be from 1; files with four decimals reach 1e-4.
const NORM_TOLERANCE: f64 = 1e-3;

/// One line of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TumPose {
    /// Time, nanoseconds; exact, never through floating point.
    pub stamp_ns: i64,
    /// Metres.
    pub position: [f64; 3],
    /// Quaternion x, y, z, w.
    pub orientation: [f64; 4],
}

/// Writes a trajectory whole or not at all: the time with nine decimals, the pose with nine (nanometres).
///
/// # Errors
/// [`FormatError::Io`] naming `path`; also for a pose that is not finite.
pub fn write<'a>(path: &Path, poses: impl IntoIterator<Item = &'a TumPose>) -> Result<(), FormatError> {
    write_atomically(path, |writer| write_to(writer, poses))
}

/// Writes to any sink.
///
/// # Errors
/// Those of the sink, and `InvalidData` for a pose that is not finite.
pub fn write_to<'a>(writer: &mut impl Write, poses: impl IntoIterator<Item = &'a TumPose>) -> io::Result<()> {
    for pose in poses {
        let sign = if pose.stamp_ns < 0 { "-" } else { "" };
        let ns = pose.stamp_ns.unsigned_abs();
        write!(writer, "{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)?;
        for value in pose.position.iter().chain(&pose.orientation) {
            if !value.is_finite() {
                let cause = format!("the pose at {} ns is not finite", pose.stamp_ns);
                return Err(io::Error::new(io::ErrorKind::InvalidData, cause));
            }
            // No "-0.000000000".
            let value = if value.abs() < 0.5e-9 { 0.0 } else { *value };
            write!(writer, " {value:.9}")?;
        }
        writeln!(writer)?;
    }
    Ok(())
}

/// Reads a whole trajectory in file order.
///
/// # Errors
/// [`FormatError`] naming the line's place in the file.
pub fn read(path: &Path) -> Result<Vec<TumPose>, FormatError> {
    let file = File::open(path).map_err(|cause| FormatError::reading(path, cause))?;
    read_from(BufReader::new(file), path)
}

/// Reads from any source; `path` is for messages only.
///
/// # Errors
/// As [`read`].
pub fn read_from(source: impl BufRead, path: &Path) -> Result<Vec<TumPose>, FormatError> {
    let mut lines = Lines::new(source, path);
    let mut poses = Vec::new();
    while let Some(line) = lines.next_line()? {
        let text = line.text.trim_ascii();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let pose = parse_line(text).map_err(|cause| {
            FormatError::malformed(path, line.start, cause, "a line is `seconds tx ty tz qx qy qz qw`")
        })?;
        poses.push(pose);
    }
    Ok(poses)
}

fn parse_line(line: &str) -> Result<TumPose, String> {
    let mut words = line.split_ascii_whitespace();
    let stamp = words.next().unwrap_or_default();
    let stamp_ns = nanoseconds(stamp).ok_or_else(|| format!("{stamp:?} is no time in seconds"))?;
    let mut values = [0.0; 7];
    for (i, value) in values.iter_mut().enumerate() {
        let word = words.next().ok_or_else(|| format!("{} values where 8 are needed", i + 1))?;
        *value = word
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| format!("{word:?} is no finite number"))?;
    }
    if words.next().is_some() {
        return Err("more than 8 values".to_owned());
    }
    let [x, y, z, qx, qy, qz, qw] = values;
    let norm = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
    if (norm - 1.0).abs() > NORM_TOLERANCE {
        return Err(format!("the quaternion's norm is {norm} and not 1"));
    }
    Ok(TumPose { stamp_ns, position: [x, y, z], orientation: [qx, qy, qz, qw] })
}

/// Decimal seconds, also in exponent form, to the nearest nanosecond in integers.
fn nanoseconds(word: &str) -> Option<i64> {
    let (negative, digits) = match word.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, word.strip_prefix('+').unwrap_or(word)),
    };
    let (mantissa, exponent) = match digits.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i16>().ok()?),
        None => (digits, 0),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    // 30 digits hold every time of 64 bits with 20 decimals, and their number fits 128 bits.
    let count = whole.len() + fraction.len();
    if !(1..=30).contains(&count) || !whole.bytes().chain(fraction.bytes()).all(|b| b.is_ascii_digit()) {
        return None;
    }
    let number = whole.bytes().chain(fraction.bytes()).fold(0i128, |n, b| n * 10 + i128::from(b - b'0'));
    let shift = 9 + i32::from(exponent) - i32::try_from(fraction.len()).ok()?;
    let ns = if number == 0 {
        0
    } else if shift >= 0 {
        number.checked_mul(10i128.checked_pow(shift.unsigned_abs())?)?
    } else {
        // Divisors beyond 128 bits leave nothing of 30 digits.
        10i128.checked_pow(shift.unsigned_abs()).map_or(0, |divisor| (number + divisor / 2) / divisor)
    };
    i64::try_from(if negative { -ns } else { ns }).ok()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read_text(text: &str) -> Result<Vec<TumPose>, FormatError> {
        read_from(text.as_bytes(), Path::new("a.tum"))
    }

    #[test]
    fn golden_line() {
        let pose = TumPose {
            stamp_ns: 1_700_000_000_100_000_001,
            position: [1.5, -0.000_000_000_1, -2.25],
            orientation: [0.0, 0.0, 0.6, 0.8],
        };
        let mut bytes = Vec::new();
        write_to(&mut bytes, [&pose]).unwrap();
        let golden = "1700000000.100000001 1.500000000 0.000000000 -2.250000000 \
            0.000000000 0.000000000 0.600000000 0.800000000\n";
        assert_eq!(String::from_utf8(bytes).unwrap(), golden);
    }

    #[test]
    fn times_as_numpy_writes_them_are_exact() {
        assert_eq!(nanoseconds("1.305031102175800085e+09"), Some(1_305_031_102_175_800_085));
        assert_eq!(nanoseconds("-0.000000001"), Some(-1));
        assert_eq!(nanoseconds("12"), Some(12_000_000_000));
        assert_eq!(nanoseconds("0.0000000005"), Some(1));
        assert_eq!(nanoseconds("1e-300"), Some(0));
        for bad in ["", ".", "-", "1e", "1e9999999", "9e18", "nan", "1.2.3", "0x10"] {
            assert_eq!(nanoseconds(bad), None, "{bad}");
        }
    }

    #[test]
    fn bad_lines_are_refused_with_their_place() {
        let good = "0.1 1 2 3 0 0 0 1\n";
        for bad in ["0.2 1 2 3 0 0 0", "0.2 1 2 3 0 0 0 1 9", "0.2 1 2 nan 0 0 0 1", "0.2 1 2 3 0 0 0 2"] {
            let error = read_text(&format!("# comment\n{good}{bad}\n")).unwrap_err().to_string();
            assert!(error.starts_with("a.tum: byte 28: "), "{error}");
        }
    }

    #[test]
    fn the_truth_of_a_simulated_walk_is_read() {
        let Some(path) = evac_testkit::data("simulated/corridor/gt.tum") else { return };
        let poses = read(&path).unwrap();
        assert!(poses.len() > 500);
        assert_eq!(poses[0].stamp_ns, 1_700_000_000_099_999_905);
        assert!(
            poses.windows(2).all(|pair| (pair[1].stamp_ns - pair[0].stamp_ns - 100_000_000).abs() < 1_000)
        );
    }

    proptest! {
        #[test]
        fn stamps_come_back_to_the_nanosecond(stamp_ns: i64, x in -1e5..1e5) {
            let pose = TumPose { stamp_ns, position: [x, 0.0, 0.0], orientation: [0.0, 0.0, 0.0, 1.0] };
            let mut bytes = Vec::new();
            write_to(&mut bytes, [&pose]).unwrap();
            let back = read_from(bytes.as_slice(), Path::new("a.tum")).unwrap();
            prop_assert_eq!(back[0].stamp_ns, stamp_ns);
            prop_assert!((back[0].position[0] - x).abs() < 0.51e-9);
        }

        #[test]
        fn mutated_and_cut_files_never_panic(
            changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
            cut: prop::sample::Index,
        ) {
            let mut bytes = b"# t x y z\n0.1 1 2 3 0 0 0 1\n1.7e9 -1.5 0 0 0.6 0.8 0 0\n".to_vec();
            for (at, value) in changes {
                *at.get_mut(&mut bytes) = value;
            }
            let _ = read_from(&bytes[..cut.index(bytes.len() + 1)], Path::new("a.tum"));
        }

        #[test]
        fn no_bytes_make_the_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _ = read_from(bytes.as_slice(), Path::new("a.tum"));
        }

        #[test]
        fn no_text_of_numbers_makes_the_reader_panic(text in "[-+0-9.eE \n#]{0,200}") {
            let _ = read_text(&text);
        }
    }
}
