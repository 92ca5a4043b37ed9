//! What the sensors say: points of a scan, and IMU samples.

use crate::layout::frame;

/// Bits of [`FrameHeader::flags`].
pub mod frame_flags {
    /// The last frame of a finite stream (a recording or a simulated walk). Every stage copies it to its output;
    /// sinks finish their files on it.
    pub const END_OF_STREAM: u32 = 1;
}

/// Bits of [`ScanHeader::scan_flags`].
pub mod scan_flags {
    /// Points are in the LiDAR frame at `end_ns` (paper Eq. 6); without it each point is in the LiDAR frame at its own time.
    pub const DESKEWED: u32 = 1;
    /// The deskewer had no IMU data that covers the scan and passed it on as it came.
    pub const IMU_MISSING: u32 = 2;
    /// No per-point time in the source: times were spread evenly over the frame.
    pub const TIMES_ASSUMED: u32 = 4;
}

frame! {
    /// The start of every frame's header.
    "evac.FrameHeader.v1", 48 bytes,
    pub struct FrameHeader {
        /// Gap-free number given by the producer and kept by every stage.
        pub seq: u64,
        /// Start of the measured interval, sensor time in nanoseconds.
        pub start_ns: i64,
        /// End of the measured interval, sensor time in nanoseconds.
        pub end_ns: i64,
        /// Host monotonic time at which the last byte of the data came in; end-to-end latency counts from here.
        pub arrival_ns: i64,
        /// Host monotonic time at which this frame was handed to shared memory; a hop's IPC latency counts from here.
        pub sent_ns: i64,
        /// Which instance of the stage wrote it.
        pub epoch: u32,
        /// See [`frame_flags`].
        pub flags: u32,
    }
}

frame! {
    /// User header of `lidar/scan` and `scan/deskewed`; the payload is a slice of [`Point`].
    "evac.ScanHeader.v2", 72 bytes,
    pub struct ScanHeader {
        /// Sequence number and times.
        pub frame: FrameHeader,
        /// See [`scan_flags`].
        pub scan_flags: u32,
        /// Points in the payload.
        pub points: u32,
        /// Shots without return that the scan held when it was measured.
        pub no_return: u32,
        /// Points dropped because a coordinate was not finite or out of the sensor's range.
        pub rejected: u32,
        /// Packets missing inside the frame.
        pub lost_packets: u32,
        /// Offset that the deskewer added to IMU stamps to get LiDAR time, microseconds; 0 in `lidar/scan`. Whoever joins
        /// the scan with IMU samples needs those up to `imu_end_ns`.
        pub time_offset_us: i32,
    }
}

/// Largest offset between the clocks of IMU and LiDAR that is followed, nanoseconds. A clock that is farther off is a
/// wrong one.
pub const MAX_TIME_OFFSET_NS: i64 = 200_000_000;

impl ScanHeader {
    /// Stamp up to which the IMU must have spoken so that its samples cover the scan: the scan's end, and with IMU stamps
    /// that run ahead (a negative `time_offset_ns`) later by as much.
    pub fn imu_end_ns(&self, time_offset_ns: i64) -> i64 {
        let lead_ns = time_offset_ns.saturating_neg().clamp(0, MAX_TIME_OFFSET_NS);
        self.frame.end_ns.saturating_add(lead_ns)
    }

    /// The deskewer's time offset, nanoseconds.
    pub fn time_offset_ns(&self) -> i64 {
        i64::from(self.time_offset_us) * 1000
    }
}

frame! {
    /// One LiDAR return. No return is `x = y = z = 0` in `lidar/scan` and absent in `scan/deskewed`.
    "evac.Point.v1", 16 bytes,
    pub struct Point {
        /// Metres, in the LiDAR frame: x forward, y left, z up.
        pub x: f32,
        /// Metres.
        pub y: f32,
        /// Metres.
        pub z: f32,
        /// Bits 8..32: time since the frame's `start_ns` in units of 10 ns; bits 0..8: reflectivity.
        pub packed: u32,
    }
}

impl Point {
    /// Longest time since the frame's start that a point can carry: (2^24 - 1) * 10 ns, about 168 ms.
    pub const MAX_OFFSET_NS: i64 = 0xff_ffff * 10;

    /// A point at `x, y, z` metres, measured `offset_ns` after the frame's start (clamped to 0..=[`Self::MAX_OFFSET_NS`]).
    #[inline]
    pub fn new(x: f32, y: f32, z: f32, offset_ns: i64, reflectivity: u8) -> Self {
        let ticks = (offset_ns.clamp(0, Self::MAX_OFFSET_NS) / 10) as u32;
        Self { x, y, z, packed: (ticks << 8) | u32::from(reflectivity) }
    }

    /// Nanoseconds since the frame's `start_ns`, in steps of 10 ns.
    #[inline]
    pub fn offset_ns(&self) -> i64 {
        i64::from(self.packed >> 8) * 10
    }

    /// Reflectivity as the sensor reports it, 0 to 255.
    #[inline]
    pub fn reflectivity(&self) -> u8 {
        self.packed as u8
    }

    /// The same measurement at another place.
    #[inline]
    pub fn moved_to(&self, x: f32, y: f32, z: f32) -> Self {
        Self { x, y, z, packed: self.packed }
    }

    /// Whether all coordinates are finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }

    /// Whether the shot came back: a sensor reports no return as the origin.
    #[inline]
    pub fn is_return(&self) -> bool {
        self.x != 0.0 || self.y != 0.0 || self.z != 0.0
    }
}

frame! {
    /// One IMU measurement on `imu/sample`, in the IMU frame.
    "evac.ImuSample.v1", 88 bytes,
    pub struct ImuSample {
        /// Gap-free number given by the producer.
        pub seq: u64,
        /// Time of the measurement, sensor time in nanoseconds (the LiDAR's time base).
        pub stamp_ns: i64,
        /// Host monotonic time at which its last byte came in.
        pub arrival_ns: i64,
        /// Host monotonic time at which it was handed to shared memory.
        pub sent_ns: i64,
        /// Angular velocity, rad/s.
        pub gyro: [f64; 3],
        /// Specific force, m/s^2 (at rest it points up with 9.81).
        pub accel: [f64; 3],
        /// Which instance of the producer wrote it.
        pub epoch: u32,
        /// See [`frame_flags`]; `END_OF_STREAM` says that no later sample will come.
        pub flags: u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_bytes_of_a_point() {
        let point = Point::new(1.0, -2.0, 0.5, 123_450, 200);
        let golden = [0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0, 0, 0, 0x3f, 200, 0x39, 0x30, 0];
        assert_eq!(bytemuck::bytes_of(&point), golden);
        assert_eq!((point.offset_ns(), point.reflectivity()), (123_450, 200));
    }

    #[test]
    fn golden_bytes_of_a_header() {
        let header =
            FrameHeader { seq: 1, start_ns: 2, end_ns: -1, arrival_ns: 3, sent_ns: 4, epoch: 5, flags: 1 };
        let mut golden = Vec::new();
        golden.extend(1u64.to_le_bytes());
        for value in [2i64, -1, 3, 4] {
            golden.extend(value.to_le_bytes());
        }
        golden.extend(5u32.to_le_bytes());
        golden.extend(1u32.to_le_bytes());
        assert_eq!(bytemuck::bytes_of(&header), golden);
    }

    #[test]
    fn times_beyond_the_frame_are_clamped() {
        assert_eq!(Point::new(0.0, 0.0, 0.0, -5, 0).offset_ns(), 0);
        assert_eq!(Point::new(0.0, 0.0, 0.0, i64::MAX, 0).offset_ns(), Point::MAX_OFFSET_NS);
    }
}
