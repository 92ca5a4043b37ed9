//! What stages say about themselves.

use crate::device::DeviceHealth;
use crate::layout::frame;

/// State of a stage, as [`Health::state`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum StageState {
    /// Ports are open, no frame has come yet.
    Waiting = 0,
    /// Frames are flowing.
    Running = 1,
    /// The stream ended and all output is written.
    Finished = 2,
    /// Stopping on an error.
    Failed = 3,
    /// A standby that follows the routed instance and could not take over yet.
    Following = 4,
    /// A standby that could take over with the next frame.
    Ready = 5,
    /// Has handed over to another instance: [`Health::last_seq`] is the last frame it has dealt with, or [`NO_SEQ`].
    Retired = 6,
    /// Processes beside the routed instance, and nobody listens to it.
    Shadow = 7,
}

/// In the place of a sequence number: there was no frame.
pub const NO_SEQ: u64 = u64::MAX;

frame! {
    /// Percentiles of one latency since the stage's start, nanoseconds.
    "evac.LatencySummary.v1", 32 bytes,
    pub struct LatencySummary {
        /// Values counted.
        pub count: u64,
        /// Median.
        pub p50_ns: u64,
        /// 99th percentile.
        pub p99_ns: u64,
        /// Largest.
        pub max_ns: u64,
    }
}

frame! {
    /// How an odometry fares since its start, for [`Health`]; all zero for other stages.
    "evac.OdometryHealth.v1", 112 bytes,
    pub struct OdometryHealth {
        /// Poses published, those before the start not counted.
        pub poses: u64,
        /// Of these, poses with directions that the LiDAR did not observe.
        pub degenerate: u64,
        /// Of these, poses without a match with the map.
        pub lost: u64,
        /// Times that the match was lost.
        pub losses: u64,
        /// Time offset of the newest pose, to add to IMU stamps, nanoseconds.
        pub time_offset_ns: i64,
        /// Gyroscope bias of the newest pose, rad/s, IMU frame.
        pub gyro_bias: [f64; 3],
        /// Accelerometer bias of the newest pose, m/s^2, IMU frame.
        pub accel_bias: [f64; 3],
        /// Standard deviation of the time offset, microseconds; 0 where it is not estimated.
        pub time_offset_sigma_us: u32,
        /// Share of the selected points that the newest match used, 0 to 1.
        pub quality: f32,
        /// Directions that the newest scan did not show.
        pub directions: u32,
        /// See [`crate::TrackingState`].
        pub state: u32,
        /// Always zero.
        pub reserved: [u32; 2],
    }
}

frame! {
    /// A stage's report on `health/status`, each second and once at its end.
    "evac.Health.v3", 568 bytes,
    pub struct Health {
        /// Instance name, UTF-8, zero padded.
        pub name: [u8; 32],
        /// Why the state is what it is, UTF-8, zero padded.
        pub reason: [u8; 96],
        /// Host monotonic time of this report.
        pub reported_ns: i64,
        /// Host monotonic time of the last frame that came in; 0 before the first.
        pub last_input_ns: i64,
        /// Frames taken in.
        pub frames_in: u64,
        /// Frames published, or written by a sink.
        pub frames_out: u64,
        /// Frames that never came: gaps in `seq`.
        pub lost: u64,
        /// Frames that came too late to be used.
        pub late: u64,
        /// Frames dropped or passed on unprocessed by decision of the stage.
        pub degraded: u64,
        /// Data dropped inside frames: points not finite or out of range.
        pub rejected: u64,
        /// IMU samples that never came.
        pub imu_lost: u64,
        /// Last sequence number published or written.
        pub last_seq: u64,
        /// From a frame's hand-over by the writer to its receipt here.
        pub ipc: LatencySummary,
        /// From taking up a frame with all its partners to hand-over of the output; time spent behind the frame before is
        /// in `end_to_end` only.
        pub compute: LatencySummary,
        /// From the arrival of the frame's last byte on the host to hand-over of the output.
        pub end_to_end: LatencySummary,
        /// Frames in per second over the last report interval, times 1000.
        pub rate_millihertz: u64,
        /// Process id.
        pub pid: u32,
        /// Instance epoch.
        pub epoch: u32,
        /// See [`StageState`].
        pub state: u32,
        /// Always zero.
        pub reserved: u32,
        /// Frames that will come in all; 0 where it is not known.
        pub total: u64,
        /// How the odometry fares, where the stage is one.
        pub odometry: OdometryHealth,
        /// How the device fares, where the stage is a driver.
        pub device: DeviceHealth,
    }
}

impl Health {
    /// Sets a zero-padded text field, cut at a character border.
    pub fn text<const N: usize>(text: &str) -> [u8; N] {
        let mut bytes = [0; N];
        let mut end = text.len().min(N);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        if let (Some(to), Some(from)) = (bytes.get_mut(..end), text.as_bytes().get(..end)) {
            to.copy_from_slice(from);
        }
        bytes
    }

    /// Reads a zero-padded text field.
    pub fn text_of(bytes: &[u8]) -> String {
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(bytes.get(..end).unwrap_or_default()).into_owned()
    }
}

frame! {
    /// A sink's word on `sink/ack` that it is done with a frame; a lossless replay paces itself on it.
    "evac.Ack.v1", 40 bytes,
    pub struct Ack {
        /// Instance name, UTF-8, zero padded.
        pub name: [u8; 24],
        /// The frame the sink is done with.
        pub seq: u64,
        /// 1 when the sink has written everything after the last frame.
        pub finished: u32,
        /// Instance epoch.
        pub epoch: u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_cut_at_a_character_border_and_read_back() {
        assert_eq!(Health::text_of(&Health::text::<8>("mapper")), "mapper");
        assert_eq!(Health::text_of(&Health::text::<5>("aaaaé")), "aaaa");
    }
}
