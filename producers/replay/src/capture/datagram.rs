//! A data packet of either of Livox's protocols.

use evac_formats::livox_sdk1::{self, ImuRecord, LivoxPoint, TimestampType};
use evac_formats::livox_sdk2;

/// Which packets of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Points,
    Imu,
}

/// A checked datagram; the protocols tell themselves apart by their first byte.
#[derive(Debug, Clone, Copy)]
pub(super) enum Datagram<'a> {
    Sdk1(livox_sdk1::Datagram<'a>),
    Sdk2(livox_sdk2::Datagram<'a>),
}

impl<'a> Datagram<'a> {
    /// Checks a payload. A recording keeps no checksum of the second protocol, so `checksum` says whether there is one.
    pub(super) fn parse(bytes: &'a [u8], checksum: bool) -> Option<Self> {
        if let Ok(datagram) = livox_sdk1::Datagram::parse(bytes) {
            return Some(Self::Sdk1(datagram));
        }
        let datagram = match checksum {
            true => livox_sdk2::Datagram::parse(bytes),
            false => livox_sdk2::Datagram::parse_unchecked(bytes),
        };
        datagram.ok().map(Self::Sdk2)
    }

    pub(super) fn kind(&self) -> Kind {
        let is_imu = match self {
            Self::Sdk1(datagram) => datagram.header.data_type == livox_sdk1::DataType::Imu,
            Self::Sdk2(datagram) => datagram.header.data_type == livox_sdk2::DataType::Imu,
        };
        if is_imu { Kind::Imu } else { Kind::Points }
    }

    /// Time of the first record, nanoseconds of the device's clock.
    pub(super) fn stamp_ns(&self) -> i64 {
        match self {
            Self::Sdk1(datagram) => datagram.header.stamp_ns,
            Self::Sdk2(datagram) => datagram.header.stamp_ns,
        }
    }

    /// Whether the clock restarts every second.
    pub(super) fn restarts(&self) -> bool {
        match self {
            Self::Sdk1(datagram) => datagram.header.timestamp_type == TimestampType::Pps,
            Self::Sdk2(_) => false,
        }
    }

    /// Slot and number of a device at a hub; devices of the second protocol have none.
    pub(super) fn place(&self) -> (u8, u8) {
        match self {
            Self::Sdk1(datagram) => (datagram.header.slot, datagram.header.lidar_id),
            Self::Sdk2(_) => (0, 0),
        }
    }

    /// Time between two shots where the packets do not show it.
    pub(super) fn usual_shot_ns(&self) -> i64 {
        use livox_sdk1::DataType::{Cartesian, Spherical};
        match self {
            Self::Sdk1(datagram) => match datagram.header.data_type {
                Cartesian | Spherical => 10_000,
                _ => 4_167,
            },
            Self::Sdk2(_) => 5_000,
        }
    }

    pub(super) fn shots(&self) -> usize {
        match self {
            Self::Sdk1(datagram) => datagram.shots(),
            Self::Sdk2(datagram) => datagram.shots(),
        }
    }

    pub(super) fn echoes(&self) -> usize {
        match self {
            Self::Sdk1(datagram) => datagram.header.data_type.echoes(),
            Self::Sdk2(datagram) => datagram.header.data_type.echoes(),
        }
    }

    pub(super) fn point(&self, index: usize) -> Option<LivoxPoint> {
        match self {
            Self::Sdk1(datagram) => datagram.point(index),
            Self::Sdk2(datagram) => datagram.point(index),
        }
    }

    pub(super) fn imu(&self) -> Option<ImuRecord> {
        match self {
            Self::Sdk1(datagram) => datagram.imu(0),
            Self::Sdk2(datagram) => datagram.imu(0),
        }
    }
}
