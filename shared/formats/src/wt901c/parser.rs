//! Finds frames in bytes, and finds them again after a loss.

use super::frame::{FRAME_BYTES, Frame, START, is_known, sum};

/// Byte-by-byte parser. On a wrong id or sum it moves on by **one** byte, as the vendor's does, since 0x55 may stand
/// anywhere inside a frame. Unlike the vendor's it also refuses ids that no module sends.
#[derive(Debug, Clone, Default)]
pub struct Parser {
    window: [u8; FRAME_BYTES],
    filled: usize,
    /// Stream position of the window's first byte.
    offset: u64,
    skipped: u64,
}

impl Parser {
    /// Takes in one byte; a frame when this byte completes one.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        let slot = self.window.get_mut(self.filled)?;
        *slot = byte;
        self.filled += 1;
        self.skip_to_start();
        if self.filled < FRAME_BYTES {
            return None;
        }
        let [_, id, payload @ .., stored] = self.window;
        if sum(&self.window).wrapping_sub(stored) == stored {
            let frame = Frame { id, payload, offset: self.offset };
            self.offset += FRAME_BYTES as u64;
            self.filled = 0;
            return Some(frame);
        }
        self.drop_first();
        self.skip_to_start();
        None
    }

    /// Bytes that belong to no frame, so far.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Bytes of an unfinished frame.
    pub fn pending(&self) -> usize {
        self.filled
    }

    /// Stream position of the first byte that is not yet decided on.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Drops bytes until the window may be the start of a frame, or is empty.
    fn skip_to_start(&mut self) {
        let [first, second, ..] = self.window;
        let may_start = first == START && (self.filled < 2 || is_known(second));
        if self.filled > 0 && !may_start {
            self.drop_first();
            self.skip_to_start();
        }
    }

    fn drop_first(&mut self) {
        self.window.copy_within(1.., 0);
        self.filled -= 1;
        self.offset += 1;
        self.skipped += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wt901c::{encode_accel, encode_gyro};

    fn frames(bytes: &[u8]) -> (Vec<Frame>, Parser) {
        let mut parser = Parser::default();
        let frames = bytes.iter().filter_map(|byte| parser.push(*byte)).collect();
        (frames, parser)
    }

    #[test]
    fn a_payload_that_looks_like_headers_is_one_frame() {
        let frame = encode_accel([0x5155, 0x5255, 0x5355], 0);
        let (found, parser) = frames(&frame);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].triple(), [0x5155, 0x5255, 0x5355]);
        assert_eq!((parser.skipped(), parser.offset()), (0, 11));
    }

    #[test]
    fn a_lost_byte_costs_one_frame_and_an_inserted_one_none_of_the_next() {
        let mut bytes = Vec::new();
        bytes.extend(encode_accel([1, 2, 3], 0));
        bytes.extend(&encode_gyro([4, 5, 6], 0)[..10]);
        bytes.extend(encode_accel([7, 8, 9], 0));
        bytes.push(0x55);
        bytes.extend(encode_gyro([10, 11, 12], 0));
        let (found, parser) = frames(&bytes);
        let triples: Vec<_> = found.iter().map(Frame::triple).collect();
        assert_eq!(triples, [[1, 2, 3], [7, 8, 9], [10, 11, 12]]);
        assert_eq!(parser.skipped(), 11);
        assert_eq!(found.iter().map(|frame| frame.offset).collect::<Vec<_>>(), [0, 21, 33]);
    }
}
