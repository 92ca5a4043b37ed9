//! Data packets, when they are due.

use evac_formats::livox_sdk1::{self, PointRecord, TimestampType, UtcTime};
use evac_formats::livox_sdk2;

use super::config::{LivoxConfig, LivoxProtocol, TimeSource};
use super::scene::Scene;
use super::sdk2::time_type;
use crate::mid40::SHOT_NS;

/// Builds the packets of one stretch of measuring.
pub(super) struct Sender {
    protocol: LivoxProtocol,
    source: TimeSource,
    scene: Box<dyn Scene>,
    shots: Vec<PointRecord>,
    number: u16,
}

impl Sender {
    pub(super) fn new(config: &LivoxConfig, scene: Box<dyn Scene>) -> Self {
        Self {
            protocol: config.protocol,
            source: config.time_source,
            scene,
            shots: Vec::with_capacity(100),
            number: 0,
        }
    }

    pub(super) fn set_source(&mut self, source: TimeSource) {
        self.source = source;
    }

    /// Shots in a packet.
    pub(super) fn packet_shots(&self) -> usize {
        match self.protocol {
            LivoxProtocol::Sdk1 => livox_sdk1::DATAGRAM_SHOTS,
            LivoxProtocol::Sdk2 => 96,
        }
    }

    /// Time of a packet, nanoseconds.
    pub(super) fn packet_ns(&self) -> i64 {
        self.packet_shots() as i64 * SHOT_NS
    }

    /// Replaces `out` by the packet with shot number `first`, which is measured at `power_on_ns` of the device's clock and `utc_ns`;
    /// false where there is nothing more to measure.
    pub(super) fn packet(&mut self, first: u64, power_on_ns: i64, utc_ns: i64, out: &mut Vec<u8>) -> bool {
        self.shots.clear();
        if !self.scene.shots(first, self.packet_shots(), &mut self.shots) {
            return false;
        }
        match self.protocol {
            LivoxProtocol::Sdk1 => {
                let (timestamp_type, stamp) = match self.source {
                    TimeSource::PowerOn => (TimestampType::PowerOn, power_on_ns.to_le_bytes()),
                    TimeSource::Ptp => (TimestampType::Ptp, utc_ns.to_le_bytes()),
                    TimeSource::Gps => (TimestampType::Utc, UtcTime::of_nanoseconds(utc_ns).to_bytes()),
                    TimeSource::Pulse => (TimestampType::Pps, utc_ns.rem_euclid(1_000_000_000).to_le_bytes()),
                };
                let fields = livox_sdk1::DataFields { status: 0, timestamp_type, stamp };
                livox_sdk1::encode_points(livox_sdk1::DataType::Cartesian, &fields, &self.shots, out);
            }
            LivoxProtocol::Sdk2 => {
                self.number = self.number.wrapping_add(1);
                let stamp_ns = if self.source == TimeSource::PowerOn { power_on_ns } else { utc_ns };
                let fields = livox_sdk2::DataFields {
                    interval: ((self.packet_shots() as i64 - 1) * SHOT_NS / 100) as u16,
                    number: self.number,
                    frame: 0,
                    time_type: time_type(self.source),
                    stamp_ns: stamp_ns.cast_unsigned(),
                };
                livox_sdk2::encode_points(livox_sdk2::DataType::Cartesian32, &fields, &self.shots, out);
            }
        }
        true
    }
}
