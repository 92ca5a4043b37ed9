//! Livox's second wire protocol (Mid-360, HAP): control frames, key lists and data datagrams. Little-endian, packed.
//!
//! Beside the first protocol: a control frame fills its datagram, its checksum covers the data only, parameters are keys
//! with values, and a data datagram carries a checksum and the time between its points. There is no heartbeat: a device
//! that was told where to send goes on sending.

mod commands;
mod diagnostics;
mod encode;
mod frame;
mod header;
mod parameters;
mod records;

pub use crate::livox_sdk1::{ImuRecord, LivoxPoint, PointRecord};
pub use commands::{HostAddress, SearchReply, WriteReply, command, ports, return_code};
pub use diagnostics::Diagnostics;
pub use encode::{DataFields, encode_imu, encode_points};
pub use frame::{Frame, FrameError, FrameKind, MAX_FRAME_BYTES, Sender};
pub use header::{DataHeader, DataType, DatagramError, TimeType};
pub use parameters::{Parameter, Parameters, ParametersWriter, WorkState, key};
pub use records::Datagram;
