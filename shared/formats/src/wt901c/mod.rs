//! The byte stream of a WIT Motion WT901C (the "standard" serial protocol): frames of 11 bytes, each with one triple of
//! 16-bit words and an 8-bit sum, no sequence number and no time but in the optional frame 0x50.

mod command;
mod encode;
mod frame;
pub mod modbus;
mod parser;
mod reader;
mod reading;
mod sample;

pub use command::{
    COMMAND_BYTES, Command, CommandParser, bandwidth_code, baud, baud_code, content, rate_code, rate_hz,
    register,
};
pub use encode::{encode, encode_accel, encode_gyro, encode_time, encode_words};
pub use frame::{FRAME_BYTES, Frame, id};
pub use parser::Parser;
pub use reader::{Wt901cCounts, Wt901cReader};
pub use reading::Reading;
pub use sample::{Assembler, RawSample, Scales};
