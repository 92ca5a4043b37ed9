//! What an IMU says beside its rates and forces.

use crate::layout::frame;

/// Bits of [`ImuAttitude::contains`].
pub mod attitude_flags {
    /// `roll_pitch_yaw` is set.
    pub const ANGLES: u32 = 1;
    /// `magnetic_field` is set.
    pub const MAGNETIC_FIELD: u32 = 2;
    /// `orientation` is set.
    pub const ORIENTATION: u32 = 4;
}

frame! {
    /// An IMU's own estimate of its attitude and its magnetometer on `imu/attitude`, at the time of a sample on `imu/sample`.
    /// No stage needs it; it is passed on for whoever wants to compare.
    "evac.ImuAttitude.v1", 128 bytes,
    pub struct ImuAttitude {
        /// Number of the sample that it belongs to.
        pub seq: u64,
        /// Time of the measurement, as the sample's.
        pub stamp_ns: i64,
        /// Host monotonic time at which its last byte came in.
        pub arrival_ns: i64,
        /// Host monotonic time at which it was handed to shared memory.
        pub sent_ns: i64,
        /// Roll, pitch and yaw, radians; yaw drifts, or follows whatever steel is near.
        pub roll_pitch_yaw: [f64; 3],
        /// Magnetic field in the sensor's own unit.
        pub magnetic_field: [f64; 3],
        /// Orientation as quaternion x, y, z, w.
        pub orientation: [f64; 4],
        /// Which instance of the producer wrote it.
        pub epoch: u32,
        /// See [`attitude_flags`].
        pub contains: u32,
        /// Always zero.
        pub reserved: [u32; 2],
    }
}
