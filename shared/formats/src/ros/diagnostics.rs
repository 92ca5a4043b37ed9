//! `diagnostic_msgs/DiagnosticArray`.

use super::wire::Encoding;
use super::writer::{Stamp, Writer};

/// How something fares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Level {
    /// As it should.
    Ok = 0,
    /// Look at it.
    Warn = 1,
    /// It has failed.
    Error = 2,
}

/// Appends a serialised message with one status to `out`.
pub fn write_diagnostics(
    out: &mut Vec<u8>,
    encoding: Encoding,
    header: &Stamp<'_>,
    (level, name, message): (Level, &str, &str),
    values: &[(&str, String)],
) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    writer.u32(1);
    writer.u8(level as u8);
    writer.string(name);
    writer.string(message);
    writer.string(""); // hardware
    writer.u32(values.len() as u32);
    for (key, value) in values {
        writer.string(key);
        writer.string(value);
    }
}
