//! A box room seen by a Mid-40 on a known motion: exact rays and inertial readings with seeded noise.

use evac_frames::{ImuSample, Point, PoseFrame, ScanHeader, frame_flags};
use evac_geometry::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use evac_geometry::{STANDARD_GRAVITY, log_so3};
use evac_stage::ScanWithImu;

use super::{Odometry, Pipeline};

const FRAME_NS: i64 = 100_000_000;
const SHOT_NS: i64 = 10_000;
const IMU_NS: i64 = 5_000_000;

/// The room, who walks in it, and what the sensors do wrong.
#[derive(Clone, Copy)]
pub struct Room {
    pub min: Vector3<f64>,
    pub max: Vector3<f64>,
    /// People (boxes of 0.5 x 0.5 x 1.8 m) who walk to and fro before the LiDAR.
    pub people: usize,
    pub range_noise: f64,
    pub gyro_bias: Vector3<f64>,
    pub accel_bias: Vector3<f64>,
    /// The gyroscope's firmware holds its output at zero while it turns slower than 0.75 degrees/s.
    pub auto_zero: bool,
    pub seed: u64,
}

impl Room {
    /// 11 x 3 x 3 m with the origin 1.2 m above the floor; from there all but the back wall is in view.
    pub fn new(seed: u64) -> Self {
        Self {
            min: Vector3::new(-3.0, -1.5, -1.2),
            max: Vector3::new(8.0, 1.5, 1.8),
            people: 0,
            range_noise: 0.02,
            gyro_bias: Vector3::new(0.003, -0.004, 0.002),
            accel_bias: Vector3::new(0.03, -0.02, 0.02),
            auto_zero: false,
            seed,
        }
    }

    /// Frames of `seconds` along `motion`, the pose of LiDAR and IMU in the room at a time in seconds.
    pub fn frames(&self, seconds: f64, motion: impl Fn(f64) -> Isometry3<f64>) -> Vec<Frame> {
        let mut random = Random(self.seed);
        let count = (seconds * 10.0).round() as i64;
        let imu: Vec<ImuSample> =
            (0..=count * FRAME_NS / IMU_NS).map(|k| self.reading(k, &motion, &mut random)).collect();
        (0..count)
            .map(|seq| {
                let (start_ns, end_ns) = (seq * FRAME_NS, (seq + 1) * FRAME_NS);
                let points: Vec<Point> =
                    (0..FRAME_NS / SHOT_NS).map(|i| self.shot(start_ns, i, &motion, &mut random)).collect();
                let mut header = ScanHeader { points: points.len() as u32, ..ScanHeader::default() };
                header.frame.seq = seq as u64;
                (header.frame.start_ns, header.frame.end_ns) = (start_ns, end_ns);
                header.frame.arrival_ns = end_ns + 7;
                header.frame.flags = if seq + 1 == count { frame_flags::END_OF_STREAM } else { 0 };
                let imu = imu[(start_ns / IMU_NS) as usize..=(end_ns / IMU_NS) as usize].to_vec();
                Frame { header, points, imu, truth: motion(end_ns as f64 * 1e-9) }
            })
            .collect()
    }

    fn reading(&self, k: i64, motion: &impl Fn(f64) -> Isometry3<f64>, random: &mut Random) -> ImuSample {
        let (time, h) = (k as f64 * IMU_NS as f64 * 1e-9, 1e-3);
        let [before, now, after] = [time - h, time, time + h].map(motion);
        let rate = log_so3(&(before.rotation.inverse() * after.rotation)) / (2.0 * h);
        let place = |pose: &Isometry3<f64>| pose.translation.vector;
        let acceleration = (place(&after) - place(&now) * 2.0 + place(&before)) / (h * h);
        let force = now.rotation.inverse() * (acceleration + Vector3::new(0.0, 0.0, STANDARD_GRAVITY));
        let held = self.auto_zero && rate.norm() < 0.75_f64.to_radians();
        let gyro = if held { Vector3::zeros() } else { rate + self.gyro_bias + random.vector(0.0014) };
        ImuSample {
            seq: k as u64,
            stamp_ns: k * IMU_NS,
            gyro: gyro.into(),
            accel: (force + self.accel_bias + random.vector(0.03)).into(),
            ..ImuSample::default()
        }
    }

    fn shot(
        &self,
        start_ns: i64,
        i: i64,
        motion: &impl Fn(f64) -> Isometry3<f64>,
        random: &mut Random,
    ) -> Point {
        let time = (start_ns + i * SHOT_NS) as f64 * 1e-9;
        let pose = motion(time);
        let beam = evac_simulator::direction(((start_ns / SHOT_NS) + i) as u64);
        let ray = pose.rotation * beam;
        let origin = pose.translation.vector;
        let mut range = f64::INFINITY;
        for axis in 0..3 {
            let wall = if ray[axis] > 0.0 { self.max[axis] } else { self.min[axis] };
            range = range.min((wall - origin[axis]) / ray[axis]);
        }
        for person in 0..self.people {
            let sway = (time * 0.8 + person as f64 * 2.1).sin() * 1.5;
            let feet = Vector3::new(1.5 + person as f64, sway, self.min.z);
            let low = feet - Vector3::new(0.25, 0.25, 0.0);
            range = range.min(enter(&origin, &ray, &low, &(feet + Vector3::new(0.25, 0.25, 1.8))));
        }
        let hit = beam * (range + random.gauss() * self.range_noise);
        Point::new(hit.x as f32, hit.y as f32, hit.z as f32, i * SHOT_NS, 100)
    }
}

/// A frame with its truth.
#[derive(Clone)]
pub struct Frame {
    pub header: ScanHeader,
    pub points: Vec<Point>,
    pub imu: Vec<ImuSample>,
    pub truth: Isometry3<f64>,
}

impl Frame {
    pub fn feed<S: Odometry>(&self, pipeline: &mut Pipeline<S>) -> PoseFrame {
        pipeline.feed(&self.header, &self.points, &self.imu)
    }

    /// As an odometry takes it that no deskewer stands before.
    pub fn input(&self) -> ScanWithImu<'_> {
        ScanWithImu {
            header: &self.header,
            points: &self.points,
            imu: &self.imu,
            imu_covers: true,
            prior: None,
        }
    }
}

/// Stands for two seconds at the origin, then goes `along` and turns by `yaw` within `seconds`, smoothly from rest
/// to rest.
pub fn glide(along: Vector3<f64>, yaw: f64, seconds: f64) -> impl Fn(f64) -> Isometry3<f64> {
    move |time| {
        let s = smooth((time - 2.0) / seconds);
        Isometry3::from_parts(
            Translation3::from(along * s),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw * s),
        )
    }
}

/// From 0 to 1 with no velocity, acceleration or jerk at both ends.
pub fn smooth(share: f64) -> f64 {
    let s = share.clamp(0.0, 1.0);
    s.powi(4) * (35.0 - 84.0 * s + 70.0 * s * s - 20.0 * s.powi(3))
}

/// Range at which the ray enters a box; infinite where it misses.
fn enter(origin: &Vector3<f64>, ray: &Vector3<f64>, low: &Vector3<f64>, high: &Vector3<f64>) -> f64 {
    let (mut near, mut far) = (0.0, f64::INFINITY);
    for axis in 0..3 {
        let (a, b) = ((low[axis] - origin[axis]) / ray[axis], (high[axis] - origin[axis]) / ray[axis]);
        near = f64::max(near, a.min(b));
        far = f64::min(far, a.max(b));
    }
    if near < far { near } else { f64::INFINITY }
}

/// Splitmix64 and Box-Muller.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn gauss(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.gauss(), self.gauss(), self.gauss()) * sigma
    }
}
