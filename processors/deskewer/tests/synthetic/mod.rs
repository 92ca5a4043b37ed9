//! A rig with an exact IMU that moves inside a box and scans its walls: everything about it is known in closed form.
#![allow(dead_code, clippy::unwrap_used)] // helpers of tests; each test binary uses its part

use evac_frames::{FrameHeader, ImuSample, Point, PoseFrame, ScanHeader, TrackingState};
use evac_geometry::nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use evac_geometry::{STANDARD_GRAVITY, set_map_from_imu, set_map_from_lidar};
use evac_stage::{Rig, ScanWithImu};

pub(crate) const FRAME_NS: i64 = 100_000_000;
pub(crate) const POINTS: usize = 10_000;
const RAMP_S: f64 = 0.4;

/// A rig that rests until `starts_s`, then speeds up smoothly to a steady turn and a steady velocity, with a gait on top.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    pub(crate) starts_s: f64,
    /// Rad/s about `axis`.
    pub(crate) turn_rate: f64,
    pub(crate) axis: Vector3<f64>,
    /// Of the IMU in the map, m/s.
    pub(crate) velocity: Vector3<f64>,
    /// Amplitude of the gait's turning, rad, about `axis`, at 1.8 Hz.
    pub(crate) sway: f64,
    pub(crate) rig: Rig,
    /// Half the edges of the box, metres.
    pub(crate) room: Vector3<f64>,
}

/// A scan with everything a stage wants to know.
pub(crate) struct Recording {
    pub(crate) header: ScanHeader,
    pub(crate) points: Vec<Point>,
    /// Point by point: the wall's axis and its coordinate in the map.
    pub(crate) walls: Vec<(usize, f64)>,
    pub(crate) imu: Vec<ImuSample>,
    pub(crate) prior: PoseFrame,
}

impl Motion {
    /// 130 deg/s about a tilted axis, with the LiDAR turned and 0.2 m away from the IMU, walls up to 30 m away.
    pub(crate) fn turning() -> Self {
        let mut rig = Rig::default();
        rig.imu_from_lidar.translation_m = [0.12, -0.05, 0.15];
        rig.imu_from_lidar.roll_pitch_yaw_deg = [3.0, -10.0, 25.0];
        Self {
            starts_s: 1.5,
            turn_rate: 130f64.to_radians(),
            axis: Vector3::new(0.1, -0.15, 1.0).normalize(),
            velocity: Vector3::zeros(),
            sway: 0.0,
            rig,
            room: Vector3::new(30.0, 20.0, 6.0),
        }
    }

    /// The same turn at 1.5 m/s.
    pub(crate) fn walking() -> Self {
        Self { velocity: Vector3::new(1.2, -0.9, 0.0), sway: 0.03, ..Self::turning() }
    }

    /// Angle, rate and its change of a ramp to rate one.
    fn ramp(&self, t: f64) -> (f64, f64, f64) {
        let (u, pi) = ((t - self.starts_s) / RAMP_S, std::f64::consts::PI);
        if u <= 0.0 {
            (0.0, 0.0, 0.0)
        } else if u < 1.0 {
            let angle = RAMP_S * (u / 2.0 - (pi * u).sin() / (2.0 * pi));
            (angle, (1.0 - (pi * u).cos()) / 2.0, pi / (2.0 * RAMP_S) * (pi * u).sin())
        } else {
            (RAMP_S * (u - 0.5), 1.0, 0.0)
        }
    }

    /// Turned angle about the axis, its rate and its acceleration.
    fn turn(&self, t: f64) -> (f64, f64) {
        let (angle, rate, _) = self.ramp(t);
        let w = 1.8 * std::f64::consts::TAU;
        let since = (t - self.starts_s).max(0.0);
        // (1 - cos) starts at rest.
        (
            self.turn_rate * angle + self.sway * (1.0 - (w * since).cos()),
            self.turn_rate * rate + self.sway * w * (w * since).sin(),
        )
    }

    pub(crate) fn map_from_imu(&self, time_ns: i64) -> Isometry3<f64> {
        let t = time_ns as f64 * 1e-9;
        let rotation = UnitQuaternion::from_axis_angle(&Unit::new_normalize(self.axis), self.turn(t).0);
        Isometry3::from_parts(Translation3::from(self.velocity * self.ramp(t).0), rotation)
    }

    pub(crate) fn map_from_lidar(&self, time_ns: i64) -> Isometry3<f64> {
        self.map_from_imu(time_ns) * self.rig.imu_from_lidar()
    }

    pub(crate) fn imu_sample(&self, stamp_ns: i64) -> ImuSample {
        let t = stamp_ns as f64 * 1e-9;
        let up = Vector3::z() * STANDARD_GRAVITY;
        let force = self.map_from_imu(stamp_ns).rotation.inverse() * (self.velocity * self.ramp(t).2 + up);
        let rate = self.axis * self.turn(t).1;
        ImuSample { stamp_ns, gyro: rate.into(), accel: force.into(), ..Default::default() }
    }

    /// Samples at 200 Hz, 2 ms off the frames' borders, from the last before `from_ns` to the first after `to_ns`.
    pub(crate) fn imu(&self, from_ns: i64, to_ns: i64) -> Vec<ImuSample> {
        let stamp = |k: i64| k * 5_000_000 + 2_000_000;
        let (first, last) =
            ((from_ns - 2_000_000).div_euclid(5_000_000), (to_ns + 3_000_000 - 1) / 5_000_000);
        (first..=last).map(|k| self.imu_sample(stamp(k))).collect()
    }

    /// The true state at `time_ns`, as an odometry would say it.
    pub(crate) fn pose(&self, time_ns: i64) -> PoseFrame {
        let mut pose = PoseFrame { state: TrackingState::Tracking as u32, ..Default::default() };
        pose.frame.end_ns = time_ns;
        set_map_from_imu(&mut pose, &self.map_from_imu(time_ns));
        set_map_from_lidar(&mut pose, &self.map_from_lidar(time_ns));
        pose.velocity = (self.velocity * self.ramp(time_ns as f64 * 1e-9).1).into();
        pose.gravity = [0.0, 0.0, -STANDARD_GRAVITY];
        pose
    }

    /// Frame `seq` of 100 ms and 10,000 points in a cone of 38.4 degrees, with the pose at the end of the frame before.
    pub(crate) fn scan(&self, seq: u64) -> Recording {
        let start_ns = seq as i64 * FRAME_NS;
        let frame = FrameHeader { seq, start_ns, end_ns: start_ns + FRAME_NS, ..Default::default() };
        let (mut points, mut walls) = (Vec::new(), Vec::new());
        for i in 0..POINTS {
            let offset_ns = i as i64 * 10_000;
            let map_from_lidar = self.map_from_lidar(start_ns + offset_ns);
            let (distance, wall) = self.hit(&map_from_lidar, &direction(i));
            let p = direction(i) * distance;
            points.push(Point::new(p.x as f32, p.y as f32, p.z as f32, offset_ns, (i % 256) as u8));
            walls.push(wall);
        }
        let from_ns = if seq == 0 { 0 } else { start_ns };
        Recording {
            header: ScanHeader { frame, points: POINTS as u32, ..Default::default() },
            points,
            walls,
            imu: self.imu(from_ns, frame.end_ns),
            prior: self.pose(start_ns),
        }
    }

    fn hit(&self, map_from_lidar: &Isometry3<f64>, direction: &Vector3<f64>) -> (f64, (usize, f64)) {
        let (origin, ray) = (map_from_lidar.translation.vector, map_from_lidar.rotation * direction);
        (0..3)
            .filter(|axis| ray[*axis] != 0.0)
            .map(|axis| {
                let wall = self.room[axis] * ray[axis].signum();
                ((wall - origin[axis]) / ray[axis], (axis, wall))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap()
    }

    /// Largest distance of the points from the walls they were measured on, when placed at the pose of `time_ns`.
    pub(crate) fn worst_error(&self, recording: &Recording, points: &[Point], time_ns: i64) -> f64 {
        assert_eq!(points.len(), recording.walls.len());
        let map_from_lidar = self.map_from_lidar(time_ns);
        let error = |(point, (axis, wall)): (&Point, &(usize, f64))| {
            let p = Vector3::new(point.x, point.y, point.z).map(f64::from);
            ((map_from_lidar * evac_geometry::nalgebra::Point3::from(p))[*axis] - wall).abs()
        };
        points.iter().zip(&recording.walls).map(error).fold(0.0, f64::max)
    }
}

impl Recording {
    pub(crate) fn input(&self) -> ScanWithImu<'_> {
        ScanWithImu {
            header: &self.header,
            points: &self.points,
            imu: &self.imu,
            imu_covers: true,
            prior: Some(&self.prior),
        }
    }

    pub(crate) fn input_without_prior(&self) -> ScanWithImu<'_> {
        ScanWithImu { prior: None, ..self.input() }
    }
}

/// Directions spread over the cone about x by the golden angle.
fn direction(i: usize) -> Vector3<f64> {
    let azimuth = i as f64 * 2.399_963;
    let off = 19.2f64.to_radians() * ((i * 7919 % POINTS) as f64 / POINTS as f64).sqrt();
    Vector3::new(off.cos(), off.sin() * azimuth.cos(), off.sin() * azimuth.sin())
}
