//! What was done with packets.

/// What was done with packets since the start.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct PacketCounts {
    /// Packets of points that went into scans.
    pub used: u64,
    /// Packets of the device's own IMU, whether they are passed on or not.
    pub imu: u64,
    /// Samples of the device's own IMU that never came, told by the time between their neighbours; where they are passed on.
    pub imu_lost: u64,
    /// Packets of points that never came, told by the time between their neighbours.
    pub lost: u64,
    /// Packets that came twice or were overtaken.
    pub late: u64,
    /// Packets from other addresses than the device's.
    pub strangers: u64,
    /// Packets of the device that are none, or whose checksum is wrong, and control datagrams likewise.
    pub damaged: u64,
    /// Packets left out because their time was not known (while the clock is being fitted, or with a damaged stamp), or because
    /// they came before the first whole scan.
    pub unsure: u64,
    /// Times that the device's clock was set or has changed its source.
    pub segments: u64,
}
