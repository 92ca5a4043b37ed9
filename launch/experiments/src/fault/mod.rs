//! What sensors, clocks, cables and people do to a walk. Every fault is a pure function of the walk and a seed.

mod imu;
mod person;
mod rig;
mod scans;

use evac_simulator::Random;

use crate::Walk;

/// One fault; the numbers are those that the robustness table is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The walk as it is.
    None,
    /// The WT901C's automatic zeroing: exact zeros at rest, and no rates under 0.8 deg/s for 0.2 s after it.
    /// A walk whose gyroscope does this already stays as it is.
    AutoZero,
    /// The IMU's clock is so many milliseconds ahead of the LiDAR's.
    ClockOffsetMs(i32),
    /// The rig's rotation is off by so many tenths of a degree, about a random axis.
    Rotation(u32),
    /// The rig's lever arm is off by 2 cm, in a random direction.
    Translation,
    /// The gyroscope reads 0.5 % too much.
    GyroScale,
    /// White noise of the accelerometer of 0.09 instead of 0.03 m/s^2 a sample.
    AccelNoise,
    /// Every range is 2 cm too long.
    RangeBias,
    /// The IMU gives every second sample only.
    Imu100Hz,
    /// Every 7 s the IMU is silent for 50 ms.
    ImuGaps,
    /// In the middle of the walk, in motion, the IMU is silent for 0.5 s.
    ImuGap,
    /// Every 10 s the LiDAR is silent for 1 s.
    LidarGaps,
    /// 5 % of the points are somewhere within 40 m, not a number, or at the origin.
    CorruptPoints,
    /// One sample of one axis of the gyroscope reads 1600 deg/s.
    GyroSpike,
    /// Stamps count from 1970.
    EpochStamps,
    /// Stamps count from some seconds before the walk.
    BootStamps,
    /// Specific force comes in g instead of m/s^2.
    ImuInG,
    /// In the middle of the walk a person stays 0.5 m before the sensor for 3 s.
    Person,
    /// The recording begins in full stride.
    StartWalking,
}

impl Fault {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 25] = [
        Self::None,
        Self::AutoZero,
        Self::ClockOffsetMs(-5),
        Self::ClockOffsetMs(5),
        Self::ClockOffsetMs(-20),
        Self::ClockOffsetMs(20),
        Self::ClockOffsetMs(-80),
        Self::ClockOffsetMs(80),
        Self::Rotation(5),
        Self::Rotation(10),
        Self::Translation,
        Self::GyroScale,
        Self::AccelNoise,
        Self::RangeBias,
        Self::Imu100Hz,
        Self::ImuGaps,
        Self::ImuGap,
        Self::LidarGaps,
        Self::CorruptPoints,
        Self::GyroSpike,
        Self::EpochStamps,
        Self::BootStamps,
        Self::ImuInG,
        Self::Person,
        Self::StartWalking,
    ];

    /// Name on the command line and in tables.
    pub fn name(self) -> String {
        match self {
            Self::None => "none".to_owned(),
            Self::AutoZero => "auto-zero".to_owned(),
            Self::ClockOffsetMs(ms) => format!("clock{ms:+}ms"),
            Self::Rotation(tenths) => format!("rotation-{}.{}deg", tenths / 10, tenths % 10),
            Self::Translation => "translation-2cm".to_owned(),
            Self::GyroScale => "gyro-scale-0.5%".to_owned(),
            Self::AccelNoise => "accel-noise-x3".to_owned(),
            Self::RangeBias => "range-bias-2cm".to_owned(),
            Self::Imu100Hz => "imu-100hz".to_owned(),
            Self::ImuGaps => "imu-gaps-50ms".to_owned(),
            Self::ImuGap => "imu-gap-0.5s".to_owned(),
            Self::LidarGaps => "lidar-gaps-1s".to_owned(),
            Self::CorruptPoints => "corrupt-points-5%".to_owned(),
            Self::GyroSpike => "gyro-spike".to_owned(),
            Self::EpochStamps => "stamps-from-epoch".to_owned(),
            Self::BootStamps => "stamps-from-boot".to_owned(),
            Self::ImuInG => "imu-in-g".to_owned(),
            Self::Person => "person-0.5m".to_owned(),
            Self::StartWalking => "start-walking".to_owned(),
        }
    }

    /// The walk with this fault. `seed` draws what is random in it.
    #[must_use]
    pub fn applied(self, walk: &Walk, seed: u64) -> Walk {
        // A stream of its own, so that the fault's numbers are not those of the walk's noise.
        let mut random = Random::new(seed, 0xfa);
        match self {
            Self::None => walk.clone(),
            Self::AutoZero => imu::auto_zero(walk),
            Self::ClockOffsetMs(ms) => imu::clock_offset(walk, i64::from(ms) * 1_000_000),
            Self::Rotation(tenths) => rig::rotated(walk, f64::from(tenths) * 0.1, &mut random),
            Self::Translation => rig::moved(walk, 0.02, &mut random),
            Self::GyroScale => imu::gyro_scale(walk, 1.005),
            Self::AccelNoise => imu::accel_noise(walk, &mut random),
            Self::RangeBias => scans::range_bias(walk, 0.02),
            Self::Imu100Hz => imu::every_second(walk),
            Self::ImuGaps => imu::gaps(walk),
            Self::ImuGap => imu::gap(walk),
            Self::LidarGaps => scans::gaps(walk),
            Self::CorruptPoints => scans::corrupt(walk, &mut random),
            Self::GyroSpike => imu::spike(walk, &mut random),
            Self::EpochStamps => scans::stamps_from(walk, 1_700_000_000_000_000_000),
            Self::BootStamps => scans::stamps_from(walk, 12_345_678_901),
            Self::ImuInG => imu::in_g(walk),
            Self::Person => person::before_the_sensor(walk, &mut random),
            Self::StartWalking => scans::start_walking(walk),
        }
    }
}

/// Index of a frame in the middle of the walk around which the walker moves for a second, or the middle itself.
fn moving_frame(walk: &Walk) -> usize {
    const FRAMES: usize = 5;
    const WALKING_M_S: f64 = 0.5;
    let middle = walk.frames.len() / 2;
    let moves = |index: &usize| {
        (index.saturating_sub(FRAMES)..=index + FRAMES).all(|near| walk.speed(near) > WALKING_M_S)
    };
    let later = (middle..walk.frames.len()).find(moves);
    let earlier = (0..middle).rev().find(moves);
    match (later, earlier) {
        (Some(later), Some(earlier)) if middle - earlier < later - middle => earlier,
        (Some(later), _) => later,
        (None, earlier) => earlier.unwrap_or(middle),
    }
}
