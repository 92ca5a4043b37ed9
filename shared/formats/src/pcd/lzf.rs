//! The LZF scheme of `DATA binary_compressed`: literal runs and back references, no entropy coding.

/// Most bytes that one input byte can become: a 3-byte back reference copies up to 264 bytes.
pub(super) const LARGEST_RATIO: u64 = 88;

/// Where in the input decoding failed, and why.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) cause: &'static str,
}

/// Decompresses into exactly `size` bytes.
pub(super) fn decompress(input: &[u8], size: usize) -> Result<Vec<u8>, Fault> {
    let mut output = Vec::with_capacity(size);
    let mut at = 0;
    while at < input.len() {
        let start = at;
        let fault = |cause| Fault { at: start, cause };
        let mut next = || {
            let byte = input.get(at).copied();
            at += 1;
            byte.map(usize::from).ok_or(fault("the compressed data end inside a symbol"))
        };
        let control = next()?;
        if control < 32 {
            let run = input.get(at..at + control + 1).ok_or(fault("a literal run goes beyond the data"))?;
            at += run.len();
            output.extend_from_slice(run);
        } else {
            let mut length = (control >> 5) + 2;
            if length == 9 {
                length += next()?;
            }
            let distance = ((control & 0x1f) << 8) + next()? + 1;
            let from =
                output.len().checked_sub(distance).ok_or(fault("a reference before the first byte"))?;
            if output.len() + length > size {
                return Err(fault("more data than the header says"));
            }
            // Byte by byte: source and target of a run overlap.
            for i in from..from + length {
                let byte = output.get(i).copied().unwrap_or_default();
                output.push(byte);
            }
        }
        if output.len() > size {
            return Err(fault("more data than the header says"));
        }
    }
    if output.len() < size {
        return Err(Fault { at, cause: "less data than the header says" });
    }
    Ok(output)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_literal_run_and_an_overlapping_reference_give_a_repetition() {
        // "ab" literally, then 6 bytes from a distance of 2, then 20 bytes (long form) from a distance of 1.
        let input = [1, b'a', b'b', 4 << 5, 1, 7 << 5, 11, 0];
        let mut expected = b"abababab".to_vec();
        expected.extend([b'b'; 20]);
        assert_eq!(decompress(&input, 28).unwrap(), expected);
    }

    #[test]
    fn bad_streams_are_refused_where_they_fail() {
        assert_eq!(decompress(&[5, 1, 2], 6).unwrap_err().at, 0);
        assert_eq!(decompress(&[0, 7, 1 << 5, 9], 4).unwrap_err().cause, "a reference before the first byte");
        assert_eq!(decompress(&[0, 7], 2).unwrap_err().cause, "less data than the header says");
        assert_eq!(decompress(&[1, 7, 7], 1).unwrap_err().cause, "more data than the header says");
    }
}
