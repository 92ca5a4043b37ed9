//! Data datagrams of Livox's first wire protocol (Mid-40, Mid-70, Mid-100, Tele-15, Horizon, Avia): an 18-byte header
//! and then records of one kind. Little-endian, packed; there is neither a checksum nor a sequence number, so loss
//! shows only as a gap between time stamps.

mod encode;
mod header;
mod records;

pub use encode::{CartesianMm, DATAGRAM_SHOTS, encode_cartesian, encode_imu};
pub use header::{DataHeader, DataType, DatagramError, TimestampType};
pub use records::{Datagram, ImuRecord, LivoxPoint};
pub(crate) use records::{extended_cartesian, imu, spherical};
