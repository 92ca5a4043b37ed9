//! The byte stream of a WIT Motion WT901C (the "standard" serial protocol): frames of 11 bytes, each with one triple of
//! 16-bit words and an 8-bit sum, no sequence number and no time but in the optional frame 0x50.

mod encode;
mod frame;
mod parser;
mod reader;
mod sample;

pub use encode::{encode_accel, encode_gyro, encode_time};
pub use frame::{FRAME_BYTES, Frame, id};
pub use parser::Parser;
pub use reader::{Wt901cCounts, Wt901cReader};
pub use sample::{Assembler, RawSample, Scales};
