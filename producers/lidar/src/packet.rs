//! A data packet of either protocol.

use evac_formats::livox_sdk1::{self, ImuRecord, LivoxPoint, TimestampType};
use evac_formats::livox_sdk2::{self, TimeType};

use crate::Protocol;

/// What a device's clock follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TimeSource {
    /// Time since power-on.
    PowerOn,
    /// A PTP master.
    Ptp,
    /// GPS or UTC.
    Gps,
    /// Time since the last pulse: starts again at 0 every second.
    Pulse,
}

/// A data packet.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Packet<'a> {
    Sdk1(livox_sdk1::Datagram<'a>),
    Sdk2(livox_sdk2::Datagram<'a>),
}

impl<'a> Packet<'a> {
    /// Reads a packet that has just come, with its checksum where it has one; `None` if it is none.
    pub(crate) fn parse(protocol: Protocol, bytes: &'a [u8]) -> Option<Self> {
        match protocol {
            Protocol::Sdk1 => livox_sdk1::Datagram::parse(bytes).ok().map(Self::Sdk1),
            Protocol::Sdk2 => livox_sdk2::Datagram::parse(bytes).ok().map(Self::Sdk2),
        }
    }

    /// Reads a packet that was read before.
    pub(crate) fn parse_again(protocol: Protocol, bytes: &'a [u8]) -> Option<Self> {
        match protocol {
            Protocol::Sdk1 => Self::parse(protocol, bytes),
            Protocol::Sdk2 => livox_sdk2::Datagram::parse_unchecked(bytes).ok().map(Self::Sdk2),
        }
    }

    /// Stamp of the first shot, nanoseconds of the device's clock.
    pub(crate) fn stamp_ns(&self) -> i64 {
        match self {
            Self::Sdk1(datagram) => datagram.header.stamp_ns,
            Self::Sdk2(datagram) => datagram.header.stamp_ns,
        }
    }

    pub(crate) fn time_source(&self) -> TimeSource {
        match self {
            Self::Sdk1(datagram) => match datagram.header.timestamp_type {
                TimestampType::PowerOn => TimeSource::PowerOn,
                TimestampType::Ptp => TimeSource::Ptp,
                TimestampType::Utc => TimeSource::Gps,
                TimestampType::Pps => TimeSource::Pulse,
            },
            Self::Sdk2(datagram) => match datagram.header.time_type {
                TimeType::PowerOn => TimeSource::PowerOn,
                TimeType::Ptp => TimeSource::Ptp,
                TimeType::Gps => TimeSource::Gps,
            },
        }
    }

    /// Time between two shots where the packet says it, nanoseconds.
    pub(crate) fn shot_ns(&self) -> Option<f64> {
        match self {
            Self::Sdk1(_) => None,
            Self::Sdk2(datagram) if datagram.shots() > 1 && datagram.header.interval_ns > 0 => {
                Some(datagram.header.interval_ns as f64 / (datagram.shots() - 1) as f64)
            }
            Self::Sdk2(_) => None,
        }
    }

    pub(crate) fn shots(&self) -> usize {
        match self {
            Self::Sdk1(datagram) => datagram.shots(),
            Self::Sdk2(datagram) => datagram.shots(),
        }
    }

    pub(crate) fn echoes(&self) -> usize {
        match self {
            Self::Sdk1(datagram) => datagram.header.data_type.echoes(),
            Self::Sdk2(datagram) => datagram.header.data_type.echoes(),
        }
    }

    /// Point `index`, all echoes of a shot together.
    #[inline]
    pub(crate) fn point(&self, index: usize) -> Option<LivoxPoint> {
        match self {
            Self::Sdk1(datagram) => datagram.point(index),
            Self::Sdk2(datagram) => datagram.point(index),
        }
    }

    /// Whether it is of the device's own IMU.
    pub(crate) fn is_imu(&self) -> bool {
        match self {
            Self::Sdk1(datagram) => datagram.header.data_type == livox_sdk1::DataType::Imu,
            Self::Sdk2(datagram) => datagram.header.data_type == livox_sdk2::DataType::Imu,
        }
    }

    /// The IMU sample of a packet that has one.
    pub(crate) fn imu(&self) -> Option<ImuRecord> {
        match self {
            Self::Sdk1(datagram) => datagram.imu(0),
            Self::Sdk2(datagram) => datagram.imu(0),
        }
    }
}
