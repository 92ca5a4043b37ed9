//! GPS times in LAZ chunks (LASzip's item GPSTIME11, version 2). Nobody here asks for them, but what follows them in a point can
//! only be decoded after them.
//!
//! Crate `laz` decodes them too, by a function that calls itself whenever the sequence changes: damaged data lead it deeper than
//! any stack. Here it is a loop that ends.

use std::io::{self, Read};

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::{ArithmeticModel, ArithmeticModelBuilder};
use laz::record::FieldDecompressor;

/// Multiples of the last difference have symbols of their own: 0 to 500, then -1 to -10 as 501 to 510.
const MULTIPLE: i32 = 500;
const NEGATIVE: i32 = 10;
/// The time of the point before.
const SAME: i32 = MULTIPLE + NEGATIVE + 1;
/// A whole time follows, which begins a sequence; higher symbols change to the next sequence but so many.
const WHOLE: i32 = SAME + 1;
const SYMBOLS: u32 = 516;
/// The same two where the last difference is 0.
const WHOLE_AFTER_NONE: i32 = 2;
const SYMBOLS_AFTER_NONE: u32 = 6;
/// Differences far off the last one until they are taken for the rule.
const EXTREMES: u32 = 3;
/// A writer changes to the sequence that it means at once.
const MOST_CHANGES: usize = 8;

/// One of four interleaved sequences of times.
#[derive(Debug, Clone, Copy, Default)]
struct Sequence {
    time: i64,
    difference: i32,
    extremes: u32,
}

/// Decoder of one chunk.
pub(super) struct GpsTime {
    sequences: [Sequence; 4],
    current: usize,
    newest: usize,
    multiples: ArithmeticModel,
    after_none: ArithmeticModel,
    numbers: IntegerDecompressor,
}

impl GpsTime {
    pub(super) fn new() -> Self {
        Self {
            sequences: [Sequence::default(); 4],
            current: 0,
            newest: 0,
            multiples: ArithmeticModelBuilder::new(SYMBOLS).build(),
            after_none: ArithmeticModelBuilder::new(SYMBOLS_AFTER_NONE).build(),
            numbers: IntegerDecompressorBuilder::new().bits(32).contexts(9).build_initialized(),
        }
    }

    fn decode<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<i64> {
        for _ in 0..MOST_CHANGES {
            let difference = self.sequences[self.current].difference;
            let (symbol, whole) = if difference == 0 {
                (decoder.decode_symbol(&mut self.after_none)? as i32, WHOLE_AFTER_NONE)
            } else {
                (decoder.decode_symbol(&mut self.multiples)? as i32, WHOLE)
            };
            if symbol > whole {
                self.current = (self.current + (symbol - whole) as usize) % self.sequences.len();
                continue;
            }
            if symbol == whole {
                self.begin_sequence(decoder)?;
            } else if difference == 0 {
                self.first_difference(decoder, symbol)?;
            } else if symbol < SAME {
                self.next_difference(decoder, symbol)?;
            }
            return Ok(self.sequences[self.current].time);
        }
        Err(io::Error::other("the GPS times change their sequence without end"))
    }

    fn begin_sequence<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> io::Result<()> {
        let before = (self.sequences[self.current].time >> 32) as i32;
        let high = self.numbers.decompress(decoder, before, 8)?;
        let low = decoder.read_int()?;
        self.newest = (self.newest + 1) % self.sequences.len();
        self.current = self.newest;
        let time = (i64::from(high) << 32) | i64::from(low);
        self.sequences[self.current] = Sequence { time, ..Sequence::default() };
        Ok(())
    }

    /// After a difference of 0: symbol 0 is another one.
    fn first_difference<R: Read>(
        &mut self,
        decoder: &mut ArithmeticDecoder<R>,
        symbol: i32,
    ) -> io::Result<()> {
        if symbol == 1 {
            let difference = self.numbers.decompress(decoder, 0, 0)?;
            let sequence = &mut self.sequences[self.current];
            sequence.time = sequence.time.wrapping_add(i64::from(difference));
            (sequence.difference, sequence.extremes) = (difference, 0);
        }
        Ok(())
    }

    fn next_difference<R: Read>(
        &mut self,
        decoder: &mut ArithmeticDecoder<R>,
        symbol: i32,
    ) -> io::Result<()> {
        let sequence = &mut self.sequences[self.current];
        let last = sequence.difference;
        // What the difference is expected to be as a multiple of the last, which numbers it is coded with, and whether it is extreme.
        let (multiple, context, extreme) = match symbol {
            0 => (0, 7, true),
            1 => (1, 1, false),
            2..10 => (symbol, 2, false),
            10..MULTIPLE => (symbol, 3, false),
            MULTIPLE => (MULTIPLE, 4, true),
            _ if MULTIPLE - symbol > -NEGATIVE => (MULTIPLE - symbol, 5, false),
            _ => (-NEGATIVE, 6, true),
        };
        let difference = self.numbers.decompress(decoder, last.wrapping_mul(multiple), context)?;
        sequence.time = sequence.time.wrapping_add(i64::from(difference));
        if symbol == 1 {
            sequence.extremes = 0;
        } else if extreme {
            sequence.extremes += 1;
            if sequence.extremes > EXTREMES {
                (sequence.difference, sequence.extremes) = (difference, 0);
            }
        }
        Ok(())
    }
}

impl<R: Read> FieldDecompressor<R> for GpsTime {
    fn size_of_field(&self) -> usize {
        size_of::<i64>()
    }

    fn decompress_first(&mut self, source: &mut R, first: &mut [u8]) -> io::Result<()> {
        let mut bytes = [0; size_of::<i64>()];
        source.read_exact(&mut bytes)?;
        self.sequences[0].time = i64::from_le_bytes(bytes);
        first.copy_from_slice(&bytes);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, field: &mut [u8]) -> io::Result<()> {
        let time = self.decode(decoder)?;
        field.copy_from_slice(&time.to_le_bytes());
        Ok(())
    }
}
