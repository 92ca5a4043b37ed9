//! Writes the fields of a message one after the other.

use super::wire::Encoding;

/// What a message's header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp<'a> {
    /// Sequence number; ROS 2 has none and it is left out.
    pub seq: u32,
    /// Nanoseconds since 1970, or of a device's own clock.
    pub stamp_ns: i64,
    /// Name of the coordinate frame.
    pub frame_id: &'a str,
}

/// Appends a message's fields to a buffer.
#[derive(Debug)]
pub struct Writer<'a> {
    out: &'a mut Vec<u8>,
    /// Where alignment counts from.
    origin: usize,
    encoding: Encoding,
}

impl<'a> Writer<'a> {
    /// Begins a message at the end of `out`; ROS 2 puts the little-endian encapsulation before it.
    pub fn new(out: &'a mut Vec<u8>, encoding: Encoding) -> Self {
        if encoding == Encoding::Cdr {
            out.extend_from_slice(&[0, 1, 0, 0]);
        }
        let origin = out.len();
        Self { out, origin, encoding }
    }

    /// CDR aligns each number to its own size; ROS 1 packs.
    pub fn align(&mut self, size: usize) {
        if self.encoding == Encoding::Cdr {
            let length = (self.out.len() - self.origin).next_multiple_of(size);
            self.out.resize(self.origin + length, 0);
        }
    }

    /// One byte.
    pub fn u8(&mut self, value: u8) {
        self.out.push(value);
    }

    /// A fixed array of bytes.
    pub fn raw(&mut self, bytes: &[u8]) {
        self.out.extend_from_slice(bytes);
    }

    /// An unsigned 32-bit number.
    pub fn u32(&mut self, value: u32) {
        self.align(4);
        self.raw(&value.to_le_bytes());
    }

    /// A 32-bit float.
    pub fn f32(&mut self, value: f32) {
        self.u32(value.to_bits());
    }

    /// An unsigned 64-bit number.
    pub fn u64(&mut self, value: u64) {
        self.align(8);
        self.raw(&value.to_le_bytes());
    }

    /// 64-bit floats of a fixed array, or of a message's fields.
    pub fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.u64(value.to_bits());
        }
    }

    /// A string; CDR ends it with a zero, which counts.
    pub fn string(&mut self, text: &str) {
        let zero = usize::from(self.encoding == Encoding::Cdr);
        self.u32((text.len() + zero) as u32);
        self.raw(text.as_bytes());
        self.raw(&[0][..zero]);
    }

    /// `builtin_interfaces/Time`. Seconds beyond 32 bits wrap, as they do in ROS.
    pub fn time(&mut self, stamp_ns: i64) {
        self.u32(stamp_ns.div_euclid(1_000_000_000) as u32);
        self.u32(stamp_ns.rem_euclid(1_000_000_000) as u32);
    }

    /// `std_msgs/Header`.
    pub fn header(&mut self, header: &Stamp<'_>) {
        if self.encoding == Encoding::Ros1 {
            self.u32(header.seq);
        }
        self.time(header.stamp_ns);
        self.string(header.frame_id);
    }
}
