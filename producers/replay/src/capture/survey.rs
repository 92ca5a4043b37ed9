//! What a capture holds, found before it is replayed.

use std::path::Path;

use evac_formats::FormatError;

use super::packets::{Device, Packets};
use crate::Config;
use crate::streams::seconds;

/// Packets from which the time between shots is taken.
const TIMED_PACKETS: usize = 1000;
/// Mid-40, Mid-70 and Mid-100 shoot 100,000 times a second; Mid-360 200,000 times; Horizon, Tele-15 and Avia 240,000 times.
const INTERVALS: [i64; 3] = [10_000, 5_000, 4_167];

/// Facts about a capture.
#[derive(Debug, Clone)]
pub(super) struct Survey {
    pub(super) device: Device,
    /// Device time of the first shot, nanoseconds.
    pub(super) first_ns: i64,
    /// Scans; the last may be up to half a period short.
    pub(super) scans: u64,
    pub(super) period_ns: i64,
    /// Time between two shots.
    pub(super) shot_ns: i64,
}

/// The time that scans cover.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    /// Start of the first scan, nanoseconds of the device's clock.
    pub(crate) start_ns: i64,
    /// End of the last.
    pub(crate) end_ns: i64,
}

impl Survey {
    pub(super) fn read(path: &Path, config: &Config) -> Result<Self, FormatError> {
        let mut packets = Packets::find(path, config.lidar_ip, config.allow_truncated)?;
        let (mut span, mut count) = (None, 0_u64);
        let mut intervals = Vec::with_capacity(TIMED_PACKETS);
        let mut previous = None;
        let mut usual = 0;
        while let Some(stamp) = packets.advance()? {
            let Some(datagram) = packets.datagram() else { continue };
            let shots = datagram.shots() as i64;
            if let Some((before, shots)) = previous.filter(|_| intervals.len() < TIMED_PACKETS) {
                intervals.push((stamp - before) / shots);
            }
            previous = Some((stamp, shots));
            usual = datagram.usual_shot_ns();
            let (first, _) = span.unwrap_or((stamp, stamp));
            span = Some((first, stamp));
            count += 1;
        }
        let (Some((first_ns, last)), Some(device)) = (span, packets.device()) else {
            return Err(no_points(path, &packets, config));
        };
        let shot_ns = shot_interval(&mut intervals, usual);
        let shots = previous.map_or(0, |(_, shots)| shots);
        let length = last.saturating_add(shots * shot_ns) - first_ns;
        let period_ns = config.scan_period_ns();
        let scans = (length + period_ns / 2) / period_ns;
        let survey = Self { device, first_ns, scans: scans as u64, period_ns, shot_ns };
        packets.tell();
        survey.tell(path, &packets, count, length);
        if scans == 0 {
            let cause = format!("{count} packets hold {:.3} s, less than half a scan", seconds(length));
            return Err(FormatError::malformed(path, packets.offset(), cause, "record longer"));
        }
        Ok(survey)
    }

    pub(super) fn span(&self) -> Span {
        let end_ns = self.first_ns.saturating_add(self.period_ns.saturating_mul(self.scans as i64));
        Span { start_ns: self.first_ns, end_ns }
    }

    fn tell(&self, path: &Path, packets: &Packets, count: u64, length: i64) {
        let (unused, counts, file) = (packets.unused(), packets.counts(), path.display());
        let Self { scans, shot_ns, device, .. } = self;
        tracing::info!("{file}: {scans} scans, {count} packets of {}, a shot each {shot_ns} ns", device.ip);
        let rest = length - self.period_ns * self.scans as i64;
        if rest > 0 {
            tracing::info!(
                "{file}: the last {:.1} ms are too short for a scan and left out",
                seconds(rest) * 1e3
            );
        }
        for (number, what) in [
            (unused.other_devices, "data packets of other devices"),
            (unused.late, "packets that came twice or too late"),
            (unused.stray, "packets with a stray time stamp"),
            (counts.fragments, "fragments of IP packets"),
            (counts.cut, "packets that were cut by the capture or are of unknown kind"),
        ] {
            if number > 0 {
                tracing::warn!("{file}: left out {number} {what}");
            }
        }
        if unused.foreign > 0 {
            tracing::info!("{file}: left out {} datagrams that are no Livox data", unused.foreign);
        }
        if let Some(offset) = counts.truncated_at {
            tracing::warn!("{file}: the capture is cut off at byte {offset}; what is before is used");
        }
    }
}

/// The median time between shots, taken as the model's where it is near one.
fn shot_interval(intervals: &mut [i64], usual: i64) -> i64 {
    let middle = intervals.len() / 2;
    if intervals.is_empty() {
        return usual;
    }
    let (_, median, _) = intervals.select_nth_unstable(middle);
    INTERVALS.into_iter().find(|known| (*median - known).abs() * 20 < *known).unwrap_or((*median).max(1))
}

fn no_points(path: &Path, packets: &Packets, config: &Config) -> FormatError {
    let counts = packets.counts();
    let whom = config.lidar_ip.map_or_else(String::new, |ip| format!(" of {ip}"));
    let cause = format!(
        "no Livox point data{whom} among {} UDP datagrams ({} packets in all)",
        counts.datagrams, counts.packets
    );
    let remedy = if packets.unused().other_devices > 0 {
        "check lidar_ip: other devices did send points"
    } else {
        "capture the interface that the LiDAR is connected to and record while it sends"
    };
    FormatError::malformed(path, packets.offset(), cause, remedy)
}
