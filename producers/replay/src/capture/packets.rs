//! The data packets of one device out of everything that was captured.

use std::fs::File;
use std::io::BufReader;
use std::net::Ipv4Addr;
use std::path::Path;

use evac_formats::FormatError;
use evac_formats::livox_sdk1::{DataHeader, DataType, Datagram, TimestampType};
use evac_formats::pcap::{PcapCounts, PcapReader, UdpDatagram};

use super::clock::{Clock, Verdict};
use crate::streams::{SECOND, seconds};

/// Year 2116: later stamps are damaged, and sums of earlier ones stay far from the limits of `i64`.
const LAST_STAMP: i64 = 1 << 62;

/// Which packets of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Points,
    Imu,
}

/// A device: its address, and its place at a hub.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Device {
    pub(super) ip: Ipv4Addr,
    slot: u8,
    lidar_id: u8,
    /// For a clock that restarts at every pulse: time of capture less stamp of the first packet of points, by which
    /// both streams count the seconds.
    pulse_origin: i64,
}

/// What was not used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Unused {
    /// Datagrams that are no Livox data: control frames, other programs.
    pub(super) foreign: u64,
    /// Data of other devices.
    pub(super) other_devices: u64,
    /// Duplicates and packets that were overtaken.
    pub(super) late: u64,
    /// Packets whose stamp fits to neither neighbour.
    pub(super) stray: u64,
}

/// Packets of one kind, of one device, with rising time stamps.
pub(super) struct Packets {
    reader: PcapReader<BufReader<File>>,
    kind: Kind,
    wanted_ip: Option<Ipv4Addr>,
    device: Option<Device>,
    clock: Clock,
    payload: Vec<u8>,
    unused: Unused,
}

impl Packets {
    /// Opens a capture for the points of the first device, or the first with the wanted address, that sends any.
    pub(super) fn find(
        path: &Path,
        wanted_ip: Option<Ipv4Addr>,
        tolerant: bool,
    ) -> Result<Self, FormatError> {
        Ok(Self {
            reader: PcapReader::open(path)?.tolerate_truncation(tolerant),
            kind: Kind::Points,
            wanted_ip,
            device: None,
            clock: Clock::default(),
            payload: Vec::with_capacity(2048),
            unused: Unused::default(),
        })
    }

    /// Opens a capture for one kind of packets of a known device.
    pub(super) fn of(path: &Path, device: Device, kind: Kind, tolerant: bool) -> Result<Self, FormatError> {
        Ok(Self { device: Some(device), kind, ..Self::find(path, None, tolerant)? })
    }

    /// Goes to the next packet: the time of its first record, nanoseconds of the device's clock.
    ///
    /// # Errors
    /// Those of the file, and a step of the device's clock.
    pub(super) fn advance(&mut self) -> Result<Option<i64>, FormatError> {
        while let Some(udp) = self.reader.next_datagram()? {
            let Ok(datagram) = Datagram::parse(udp.payload) else {
                self.unused.foreign += 1;
                continue;
            };
            let kind = if datagram.header.data_type == DataType::Imu { Kind::Imu } else { Kind::Points };
            let Some(device) =
                self.device.or_else(|| first_device(&udp, &datagram.header, kind, self.wanted_ip))
            else {
                self.unused.other_devices += 1;
                continue;
            };
            self.device = Some(device);
            let DataHeader { slot, lidar_id, .. } = datagram.header;
            if (*udp.source.ip(), slot, lidar_id) != (device.ip, device.slot, device.lidar_id) {
                self.unused.other_devices += 1;
                continue;
            }
            if kind != self.kind {
                continue;
            }
            let stamp = device_time(&datagram.header, udp.time_ns, device.pulse_origin);
            if !(0..=LAST_STAMP).contains(&stamp) {
                self.unused.stray += 1;
                continue;
            }
            match self.clock.judge(stamp) {
                Verdict::Accept => {
                    self.payload.clear();
                    self.payload.extend_from_slice(udp.payload);
                    return Ok(Some(stamp));
                }
                Verdict::Late => self.unused.late += 1,
                Verdict::Stray => self.unused.stray += 1,
                Verdict::Step { from } => {
                    let offset = udp.offset;
                    let cause = format!(
                        "the LiDAR's clock steps from {:.3} s to {:.3} s",
                        seconds(from),
                        seconds(stamp)
                    );
                    let remedy =
                        "the device was restarted or synchronised there: cut the capture at that packet";
                    return Err(FormatError::malformed(self.reader.path(), offset, cause, remedy));
                }
            }
        }
        Ok(None)
    }

    /// The packet that [`Packets::advance`] has found.
    pub(super) fn datagram(&self) -> Option<Datagram<'_>> {
        Datagram::parse(&self.payload).ok()
    }

    pub(super) fn device(&self) -> Option<Device> {
        self.device
    }

    pub(super) fn unused(&self) -> Unused {
        self.unused
    }

    pub(super) fn counts(&self) -> PcapCounts {
        self.reader.counts()
    }

    /// Bytes read.
    pub(super) fn offset(&self) -> u64 {
        self.reader.offset()
    }
}

fn first_device(
    udp: &UdpDatagram<'_>,
    header: &DataHeader,
    kind: Kind,
    wanted: Option<Ipv4Addr>,
) -> Option<Device> {
    let ip = *udp.source.ip();
    if kind != Kind::Points || wanted.is_some_and(|wanted| wanted != ip) {
        return None;
    }
    let pulse_origin = udp.time_ns.saturating_sub(header.stamp_ns);
    Some(Device { ip, slot: header.slot, lidar_id: header.lidar_id, pulse_origin })
}

/// The stamp; for a clock that restarts every second, with the seconds since the first packet put back.
fn device_time(header: &DataHeader, captured_ns: i64, pulse_origin: i64) -> i64 {
    if header.timestamp_type != TimestampType::Pps {
        return header.stamp_ns;
    }
    let elapsed = captured_ns.saturating_sub(pulse_origin).saturating_sub(header.stamp_ns);
    header
        .stamp_ns
        .saturating_add(elapsed.saturating_add(SECOND / 2).div_euclid(SECOND).saturating_mul(SECOND))
}
