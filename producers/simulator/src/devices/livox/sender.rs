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
    /// Points with tags, as of an Avia.
    is_tagged: bool,
    scene: Box<dyn Scene>,
    shots: Vec<PointRecord>,
    /// Status word of the first protocol.
    pub(super) status: u32,
    number: u16,
    imu_number: u16,
}

impl Sender {
    pub(super) fn new(config: &LivoxConfig, scene: Box<dyn Scene>) -> Self {
        Self {
            protocol: config.protocol,
            source: config.time_source,
            is_tagged: config.imu,
            scene,
            shots: Vec::with_capacity(100),
            status: 0,
            number: 0,
            imu_number: 0,
        }
    }

    pub(super) fn set_source(&mut self, source: TimeSource) {
        self.source = source;
    }

    /// Shots in a packet.
    pub(super) fn packet_shots(&self) -> usize {
        match self.protocol {
            LivoxProtocol::Sdk1 if !self.is_tagged => livox_sdk1::DATAGRAM_SHOTS,
            LivoxProtocol::Sdk1 | LivoxProtocol::Sdk2 => 96,
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
                use livox_sdk1::DataType::{Cartesian, ExtendedCartesian};
                let data_type = if self.is_tagged { ExtendedCartesian } else { Cartesian };
                livox_sdk1::encode_points(data_type, &self.fields1(power_on_ns, utc_ns), &self.shots, out);
            }
            LivoxProtocol::Sdk2 => {
                self.number = self.number.wrapping_add(1);
                let interval = ((self.packet_shots() as i64 - 1) * SHOT_NS / 100) as u16;
                let fields = self.fields2(interval, self.number, power_on_ns, utc_ns);
                livox_sdk2::encode_points(livox_sdk2::DataType::Cartesian32, &fields, &self.shots, out);
            }
        }
        true
    }

    /// Replaces `out` by the packet with sample `number` of the device's own IMU, as [`Self::packet`].
    pub(super) fn sample(&mut self, number: u64, power_on_ns: i64, utc_ns: i64, out: &mut Vec<u8>) -> bool {
        let Some(record) = self.scene.sample(number) else { return false };
        match self.protocol {
            LivoxProtocol::Sdk1 => {
                let fields = self.fields1(power_on_ns, utc_ns);
                livox_sdk1::encode_imu(&fields, record.gyro, record.accel_g, out);
            }
            LivoxProtocol::Sdk2 => {
                self.imu_number = self.imu_number.wrapping_add(1);
                let fields = self.fields2(0, self.imu_number, power_on_ns, utc_ns);
                livox_sdk2::encode_imu(&fields, record.gyro, record.accel_g, out);
            }
        }
        true
    }

    fn fields1(&self, power_on_ns: i64, utc_ns: i64) -> livox_sdk1::DataFields {
        let (timestamp_type, stamp) = match self.source {
            TimeSource::PowerOn => (TimestampType::PowerOn, power_on_ns.to_le_bytes()),
            TimeSource::Ptp => (TimestampType::Ptp, utc_ns.to_le_bytes()),
            TimeSource::Gps => (TimestampType::Utc, UtcTime::of_nanoseconds(utc_ns).to_bytes()),
            TimeSource::Pulse => (TimestampType::Pps, utc_ns.rem_euclid(1_000_000_000).to_le_bytes()),
        };
        livox_sdk1::DataFields { status: self.status, timestamp_type, stamp }
    }

    fn fields2(&self, interval: u16, number: u16, power_on_ns: i64, utc_ns: i64) -> livox_sdk2::DataFields {
        let stamp_ns = if self.source == TimeSource::PowerOn { power_on_ns } else { utc_ns };
        livox_sdk2::DataFields {
            interval,
            number,
            frame: 0,
            time_type: time_type(self.source),
            stamp_ns: stamp_ns.cast_unsigned(),
        }
    }
}
