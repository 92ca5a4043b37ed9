//! Frames as ROS 2 messages. Times are those of the sensors; frames of reference are `map`, `lidar` and `imu`.

use evac_formats::ros::{
    CloudField, Datatype, Encoding, Grid, Level, RosPose, Stamp, write_cloud, write_diagnostics, write_grid,
    write_imu, write_octets, write_odometry, write_pose, write_transform,
};
use evac_frames::{
    GridHeader, Health, ImuSample, MapHeader, Point, PoseFrame, ScanHeader, StageState, Voxel, scan_flags,
};
use evac_stage::{MapMessage, Tapped};

const CDR: Encoding = Encoding::Cdr;
const MAP: &str = "map";
const LIDAR: &str = "lidar";
const IMU: &str = "imu";

/// `t` is the time after the header's stamp in nanoseconds, as Ouster names it and odometries read it.
const SCAN_FIELDS: [CloudField; 5] = [
    CloudField { name: "x", offset: 0, datatype: Datatype::F32 },
    CloudField { name: "y", offset: 4, datatype: Datatype::F32 },
    CloudField { name: "z", offset: 8, datatype: Datatype::F32 },
    CloudField { name: "intensity", offset: 12, datatype: Datatype::F32 },
    CloudField { name: "t", offset: 16, datatype: Datatype::U32 },
];
const SCAN_STEP: u32 = 20;

const VOXEL_FIELDS: [CloudField; 4] = [
    CloudField { name: "x", offset: 0, datatype: Datatype::F32 },
    CloudField { name: "y", offset: 4, datatype: Datatype::F32 },
    CloudField { name: "z", offset: 8, datatype: Datatype::F32 },
    CloudField { name: "log_odds", offset: 12, datatype: Datatype::F32 },
];
const VOXEL_STEP: u32 = 16;

/// The covariance begins so where the orientation is not measured, by definition of `sensor_msgs/Imu`.
const NO_ORIENTATION: [f64; 9] = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Appends the ROS 2 message of what came to `out`; nothing for what has none.
pub(crate) fn write_ros(out: &mut Vec<u8>, tapped: &Tapped<'_>) {
    match tapped {
        Tapped::Scan(header, points) | Tapped::Deskewed(header, points) => scan(out, header, points),
        Tapped::Imu(sample) => imu(out, sample),
        Tapped::Pose(pose) => odometry(out, pose),
        Tapped::Truth(pose) => {
            write_pose(out, CDR, &stamp(pose.frame.seq, pose.frame.end_ns, MAP), &ros_pose(pose));
        }
        Tapped::Map(message) => voxels(out, message),
        Tapped::Grid(header, cells) => grid(out, header, cells),
        Tapped::Health(health, now_ns) => diagnostics(out, health, *now_ns),
        Tapped::Attitude(_) | Tapped::Route(..) => {}
    }
}

/// Appends the transform from map to LiDAR that a pose is.
pub(crate) fn write_tf(out: &mut Vec<u8>, pose: &PoseFrame) {
    write_transform(out, CDR, &stamp(pose.frame.seq, pose.frame.end_ns, MAP), LIDAR, &ros_pose(pose));
}

/// Appends the frame as it lies in shared memory, header first.
pub(crate) fn write_raw(out: &mut Vec<u8>, tapped: &Tapped<'_>) {
    let parts: [&[u8]; 2] = match tapped {
        Tapped::Scan(header, points) | Tapped::Deskewed(header, points) => {
            [bytemuck::bytes_of(*header), bytemuck::cast_slice(points)]
        }
        Tapped::Imu(sample) => [bytemuck::bytes_of(*sample), &[]],
        Tapped::Pose(pose) | Tapped::Truth(pose) => [bytemuck::bytes_of(*pose), &[]],
        Tapped::Map(message) => [bytemuck::bytes_of(message.header), bytemuck::cast_slice(message.voxels)],
        Tapped::Grid(header, cells) => [bytemuck::bytes_of(*header), cells],
        Tapped::Health(health, _) => [bytemuck::bytes_of(*health), &[]],
        Tapped::Attitude(attitude) => [bytemuck::bytes_of(*attitude), &[]],
        Tapped::Route(route, _) => [bytemuck::bytes_of(*route), &[]],
    };
    write_octets(out, CDR, &parts);
}

fn stamp(seq: u64, stamp_ns: i64, frame_id: &str) -> Stamp<'_> {
    Stamp { seq: seq as u32, stamp_ns, frame_id }
}

fn ros_pose(pose: &PoseFrame) -> RosPose {
    RosPose { position: pose.position, orientation: pose.orientation }
}

/// A scan with motion in it is stamped at its start, a deskewed one at its end, where its coordinates hold.
fn scan(out: &mut Vec<u8>, header: &ScanHeader, points: &[Point]) {
    let deskewed = header.scan_flags & scan_flags::DESKEWED != 0;
    let at = if deskewed { header.frame.end_ns } else { header.frame.start_ns };
    let header = stamp(header.frame.seq, at, LIDAR);
    write_cloud(out, CDR, &header, &SCAN_FIELDS, SCAN_STEP, points.len() as u32, |out| {
        for point in points {
            let intensity = f32::from(point.reflectivity());
            for value in [point.x, point.y, point.z, intensity] {
                out.extend_from_slice(&value.to_le_bytes());
            }
            let since = if deskewed { 0 } else { point.offset_ns() as u32 };
            out.extend_from_slice(&since.to_le_bytes());
        }
    });
}

fn imu(out: &mut Vec<u8>, sample: &ImuSample) {
    write_imu(out, CDR, &stamp(sample.seq, sample.stamp_ns, IMU), sample.gyro, sample.accel, NO_ORIENTATION);
}

/// The velocity is left 0 with a covariance that says so: it is the IMU's, in another frame.
fn odometry(out: &mut Vec<u8>, pose: &PoseFrame) {
    let mut unknown = [0.0; 36];
    for axis in 0..6 {
        unknown[axis * 7] = 1e9;
    }
    let header = stamp(pose.frame.seq, pose.frame.end_ns, MAP);
    write_odometry(out, CDR, &header, LIDAR, (&ros_pose(pose), &pose.covariance), (&[0.0; 6], &unknown));
}

/// The centres of the voxels that changed, with their new log-odds.
fn voxels(out: &mut Vec<u8>, MapMessage { header, voxels }: &MapMessage<'_>) {
    let MapHeader { frame, resolution, .. } = **header;
    // OctoMap's keys: floor(coordinate / resolution) + 32768.
    let centre = |key: u16| ((f64::from(key) - 32_767.5) * resolution) as f32;
    let header = stamp(frame.seq, frame.end_ns, MAP);
    write_cloud(out, CDR, &header, &VOXEL_FIELDS, VOXEL_STEP, voxels.len() as u32, |out| {
        for Voxel { key: [x, y, z], log_odds, .. } in *voxels {
            for value in [centre(*x), centre(*y), centre(*z), *log_odds] {
                out.extend_from_slice(&value.to_le_bytes());
            }
        }
    });
}

fn grid(out: &mut Vec<u8>, header: &GridHeader, cells: &[u8]) {
    let GridHeader { frame, resolution, origin, width, height, .. } = *header;
    write_grid(
        out,
        CDR,
        &stamp(frame.seq, frame.end_ns, MAP),
        &Grid { resolution, origin, width, height },
        cells,
    );
}

/// One a second from each stage; the only message for which texts are made.
fn diagnostics(out: &mut Vec<u8>, health: &Health, now_ns: i64) {
    let (level, text) = match health.state {
        state if state == StageState::Failed as u32 => (Level::Error, Health::text_of(&health.reason)),
        _ if health.lost + health.late > 0 => (Level::Warn, "frames were lost or late".to_owned()),
        state if state == StageState::Waiting as u32 => (Level::Ok, "waiting".to_owned()),
        state if state == StageState::Finished as u32 => (Level::Ok, "finished".to_owned()),
        _ => (Level::Ok, "running".to_owned()),
    };
    let numbers = [
        ("frames in", health.frames_in),
        ("frames out", health.frames_out),
        ("lost", health.lost),
        ("late", health.late),
        ("degraded", health.degraded),
        ("rejected", health.rejected),
        ("IMU samples lost", health.imu_lost),
        ("end to end p99, us", health.end_to_end.p99_ns / 1000),
    ];
    let values = numbers.map(|(name, value)| (name, value.to_string()));
    let name = Health::text_of(&health.name);
    write_diagnostics(out, CDR, &stamp(0, now_ns, ""), (level, &name, &text), &values);
}
