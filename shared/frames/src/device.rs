//! What a driver knows of its device.

use crate::layout::frame;

/// Kind of a device, as [`DeviceHealth::kind`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum DeviceKind {
    /// None: the stage is no driver.
    None = 0,
    /// A Livox LiDAR by the first wire protocol.
    LivoxSdk1 = 1,
    /// A Livox LiDAR by the second wire protocol.
    LivoxSdk2 = 2,
    /// A WT901C.
    Wt901c = 3,
}

/// In the place of a device's state: it has said none.
pub const NO_DEVICE_STATE: u32 = u32::MAX;
/// In the place of a temperature: the device has said none.
pub const NO_TEMPERATURE: i32 = i32::MIN;

frame! {
    /// How a device fares, for [`crate::Health`]: what it says of itself, as it stands on the wire, and what its driver has counted
    /// since its start. All zero for a stage that is no driver.
    "evac.DeviceHealth.v1", 120 bytes,
    pub struct DeviceHealth {
        /// Packets of points (LiDAR) or samples (IMU) that were used.
        pub used: u64,
        /// ... that never came.
        pub lost: u64,
        /// ... that came twice or were overtaken.
        pub late: u64,
        /// ... from other addresses than the device's.
        pub foreign: u64,
        /// Packets that are none or whose checksum is wrong (LiDAR); bytes outside of valid frames (IMU).
        pub corrupt: u64,
        /// ... left out because their time was not known yet.
        pub untimed: u64,
        /// Samples of a LiDAR's own IMU that came.
        pub imu: u64,
        /// Times that the device's clock was set or has changed its source.
        pub clock_steps: u64,
        /// Sessions begun (LiDAR), times that the port was opened (IMU).
        pub sessions: u64,
        /// See [`DeviceKind`].
        pub kind: u32,
        /// What a LiDAR does, as its protocol numbers it, or [`NO_DEVICE_STATE`].
        pub state: u32,
        /// Status word of the first protocol, diagnostics (key 0x800e) of the second.
        pub status: u32,
        /// Temperature, 0.01 degrees Celsius, or [`NO_TEMPERATURE`].
        pub temperature_centi: i32,
        /// Codes of the health management system (second protocol, key 0x8011); 0 for none.
        pub codes: [u32; 8],
    }
}
