//! Livox's first wire protocol (Mid-40, Mid-70, Mid-100, Tele-15, Horizon, Avia): control frames with commands and answers,
//! and data datagrams, an 18-byte header and then records of one kind. Little-endian, packed; data has neither a checksum
//! nor a sequence number, so loss shows only as a gap between time stamps.

mod commands;
mod encode;
mod fields;
mod frame;
mod header;
mod records;
mod replies;

pub use commands::Request;
pub use encode::{
    CartesianMm, DATAGRAM_SHOTS, DataFields, PointRecord, encode_cartesian, encode_imu, encode_points,
};
pub use fields::{Extrinsic, Network, ReturnMode, Status, UtcTime, WorkState};
pub use frame::{Frame, FrameKind, Frames, MAX_FRAME_BYTES};
pub use header::{DataHeader, DataType, DatagramError, TimestampType};
pub use records::{Datagram, ImuRecord, LivoxPoint};
pub(crate) use records::{extended_cartesian, imu, spherical};
pub use replies::{Broadcast, Reply};
