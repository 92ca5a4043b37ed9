//! The data packets of one device out of everything that was captured.

use std::net::Ipv4Addr;
use std::path::Path;

use evac_formats::FormatError;
use evac_formats::pcap::PcapCounts;

use super::clock::{Clock, Verdict};
use super::datagram::Datagram;
pub(super) use super::datagram::Kind;
use super::file::{PacketFile, RawPacket};
use crate::streams::{SECOND, seconds};

/// Year 2116: later stamps are damaged, and sums of earlier ones stay far from the limits of `i64`.
const LAST_STAMP: i64 = 1 << 62;

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
    file: PacketFile,
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
            file: PacketFile::open(path, tolerant)?,
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
        let checksum = self.file.has_checksums();
        while let Some(packet) = self.file.next_packet()? {
            let Some(datagram) = Datagram::parse(packet.payload, checksum) else {
                self.unused.foreign += 1;
                continue;
            };
            let kind = datagram.kind();
            let Some(device) = self.device.or_else(|| first_device(&packet, &datagram, self.wanted_ip))
            else {
                self.unused.other_devices += 1;
                continue;
            };
            self.device = Some(device);
            let (slot, lidar_id) = datagram.place();
            if (packet.source, slot, lidar_id) != (device.ip, device.slot, device.lidar_id) {
                self.unused.other_devices += 1;
                continue;
            }
            if kind != self.kind {
                continue;
            }
            let stamp = device_time(&datagram, packet.time_ns, device.pulse_origin);
            if !(0..=LAST_STAMP).contains(&stamp) {
                self.unused.stray += 1;
                continue;
            }
            match self.clock.judge(stamp) {
                Verdict::Accept => {
                    self.payload.clear();
                    self.payload.extend_from_slice(packet.payload);
                    return Ok(Some(stamp));
                }
                Verdict::Late => self.unused.late += 1,
                Verdict::Stray => self.unused.stray += 1,
                Verdict::Step { from } => {
                    let offset = packet.offset;
                    let cause = format!(
                        "the LiDAR's clock steps from {:.3} s to {:.3} s",
                        seconds(from),
                        seconds(stamp)
                    );
                    let remedy =
                        "the device was restarted or synchronised there: cut the capture at that packet";
                    return Err(FormatError::malformed(self.file.path(), offset, cause, remedy));
                }
            }
        }
        Ok(None)
    }

    /// The packet that [`Packets::advance`] has found.
    pub(super) fn datagram(&self) -> Option<Datagram<'_>> {
        // Its checksum, where it had one, was compared before.
        Datagram::parse(&self.payload, false)
    }

    pub(super) fn device(&self) -> Option<Device> {
        self.device
    }

    pub(super) fn unused(&self) -> Unused {
        self.unused
    }

    pub(super) fn counts(&self) -> PcapCounts {
        self.file.counts()
    }

    /// Says what the file knows about its devices.
    pub(super) fn tell(&self) {
        self.file.tell();
    }

    /// Bytes read.
    pub(super) fn offset(&self) -> u64 {
        self.file.offset()
    }
}

fn first_device(packet: &RawPacket<'_>, datagram: &Datagram<'_>, wanted: Option<Ipv4Addr>) -> Option<Device> {
    let ip = packet.source;
    if datagram.kind() != Kind::Points || wanted.is_some_and(|wanted| wanted != ip) {
        return None;
    }
    let (slot, lidar_id) = datagram.place();
    let pulse_origin = packet.time_ns.saturating_sub(datagram.stamp_ns());
    Some(Device { ip, slot, lidar_id, pulse_origin })
}

/// The stamp; for a clock that restarts every second, with the seconds since the first packet put back.
fn device_time(datagram: &Datagram<'_>, captured_ns: i64, pulse_origin: i64) -> i64 {
    let stamp_ns = datagram.stamp_ns();
    if !datagram.restarts() {
        return stamp_ns;
    }
    let elapsed = captured_ns.saturating_sub(pulse_origin).saturating_sub(stamp_ns);
    stamp_ns.saturating_add(elapsed.saturating_add(SECOND / 2).div_euclid(SECOND).saturating_mul(SECOND))
}
