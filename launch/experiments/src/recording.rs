//! Walks from recordings: `lidar.pcap`, `wt901c.bin` (either may be packed, `.xz`), the truth as `gt.tum` or `truth.tum`, and
//! the rig as `meta.json` or `rig.toml`.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use evac_config::{ImuFromLidar, RigFile};
use evac_formats::tum;
use evac_frames::{ImuSample, Point, ScanHeader};
use evac_geometry::isometry;
use evac_geometry::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use evac_replay::Replay;
use evac_stage::{Rig, SensorEvent, Source as _};
use serde::Deserialize;
use tempfile::TempDir;

use crate::join::slice;
use crate::{ExperimentError, Frame, View, Walk};

/// The part of `meta.json` that is needed.
#[derive(Debug, Deserialize)]
struct Meta {
    /// Lever arm in metres, then yaw, pitch and roll in degrees.
    #[serde(rename = "T_imu_lidar_xyz_ypr")]
    imu_from_lidar: [f64; 6],
    /// Where the truth's first pose stood in a level frame.
    world_pose_first_frame_end: WorldPose,
}

#[derive(Debug, Deserialize)]
struct WorldPose {
    /// Quaternion x, y, z, w.
    q: [f64; 4],
}

/// Reads the walk in `folder` into memory.
///
/// # Errors
/// [`ExperimentError::File`] naming the file and what to try, [`ExperimentError::Stage`] for what the replay refuses.
pub fn read_recording(name: &str, folder: &Path) -> Result<Walk, ExperimentError> {
    let scratch = TempDir::new().map_err(|cause| ExperimentError::file(std::env::temp_dir(), cause))?;
    let (rig, level_from_truth) = rig(folder)?;
    let config = evac_replay::Config {
        lidar: Some(unpacked(folder, "lidar.pcap", &scratch)?),
        imu: Some(unpacked(folder, "wt901c.bin", &scratch)?),
        ..Default::default()
    };
    let (scans, imu) = read_streams(name, config, &rig, f64::INFINITY)?;
    let truth = truth(folder, scans.len())?;
    let mut frames: Vec<_> = scans
        .into_iter()
        .zip(truth)
        .map(|((header, points), truth)| Frame {
            header,
            points: points.into(),
            imu: Vec::new(),
            truth: level_from_truth * truth,
            view: View::Unknown,
        })
        .collect();
    slice(&mut frames, &imu);
    Ok(Walk { name: name.to_owned(), rig, frames })
}

/// Reads a recording without a truth into memory, which then is the identity; at most the first `duration_s` seconds of it.
///
/// # Errors
/// [`ExperimentError::Stage`] for what the replay refuses.
pub fn read_replay(
    name: &str,
    config: evac_replay::Config,
    rig: &Rig,
    duration_s: f64,
) -> Result<Walk, ExperimentError> {
    let (scans, imu) = read_streams(name, config, rig, duration_s)?;
    let frame = |(header, points): (ScanHeader, Vec<Point>)| Frame {
        header,
        points: points.into(),
        imu: Vec::new(),
        truth: Isometry3::identity(),
        view: View::Unknown,
    };
    let mut frames: Vec<_> = scans.into_iter().map(frame).collect();
    slice(&mut frames, &imu);
    Ok(Walk { name: name.to_owned(), rig: *rig, frames })
}

type Streams = (Vec<(ScanHeader, Vec<Point>)>, Vec<ImuSample>);

/// All scans and IMU samples of the first seconds.
fn read_streams(
    name: &str,
    config: evac_replay::Config,
    rig: &Rig,
    duration_s: f64,
) -> Result<Streams, ExperimentError> {
    let stage = |cause| ExperimentError::Stage { about: name.to_owned(), cause };
    let mut replay = Replay::new(config, rig).map_err(stage)?;
    let (mut scans, mut imu): Streams = (Vec::new(), Vec::new());
    let mut start_ns = None;
    while let Some(event) = replay.next_event().map_err(stage)? {
        match event {
            SensorEvent::Imu(mut sample) => {
                sample.seq = imu.len() as u64;
                imu.push(sample);
            }
            SensorEvent::Scan(mut header) => {
                let start_ns = *start_ns.get_or_insert(header.frame.start_ns);
                if header.frame.end_ns.saturating_sub(start_ns) as f64 * 1e-9 > duration_s {
                    break;
                }
                header.frame.seq = scans.len() as u64;
                scans.push((header, (0..header.points as usize).map(|index| replay.point(index)).collect()));
            }
        }
    }
    Ok((scans, imu))
}

/// The rig, and the rotation that levels the truth.
fn rig(folder: &Path) -> Result<(Rig, Isometry3<f64>), ExperimentError> {
    let (meta, file) = (folder.join("meta.json"), folder.join("rig.toml"));
    if !meta.exists() {
        let rig = RigFile::read(&file).map_err(|cause| ExperimentError::Option(cause.to_string()))?;
        return Ok((rig, Isometry3::identity()));
    }
    let opened = File::open(&meta).map_err(|cause| ExperimentError::file(&meta, cause))?;
    let read: Meta = serde_json::from_reader(opened).map_err(|cause| ExperimentError::file(&meta, cause))?;
    let [x, y, z, yaw, pitch, roll] = read.imu_from_lidar;
    let imu_from_lidar = ImuFromLidar { translation_m: [x, y, z], roll_pitch_yaw_deg: [roll, pitch, yaw] };
    let world = isometry([0.0; 3], read.world_pose_first_frame_end.q).rotation;
    let forward = world * Vector3::x();
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), forward.y.atan2(forward.x));
    let level = Isometry3::from_parts(Translation3::identity(), heading.inverse() * world);
    Ok((Rig { imu_from_lidar }, level))
}

fn truth(folder: &Path, scans: usize) -> Result<Vec<Isometry3<f64>>, ExperimentError> {
    let (first, second) = (folder.join("gt.tum"), folder.join("truth.tum"));
    let path = if first.exists() { first } else { second };
    let poses = tum::read(&path).map_err(|cause| ExperimentError::file(&path, cause))?;
    if poses.len() != scans {
        let cause = format!("{} poses for {scans} scans; it must hold one for each scan's end", poses.len());
        return Err(ExperimentError::file(path, cause));
    }
    Ok(poses.iter().map(|pose| isometry(pose.position, pose.orientation)).collect())
}

/// The file itself, or its packed form unpacked into `scratch`.
fn unpacked(folder: &Path, name: &str, scratch: &TempDir) -> Result<PathBuf, ExperimentError> {
    let (plain, packed) = (folder.join(name), folder.join(format!("{name}.xz")));
    if plain.exists() {
        return Ok(plain);
    }
    if !packed.exists() {
        return Err(ExperimentError::file(
            plain,
            "is not there, nor with .xz after its name; check the folder",
        ));
    }
    let path = scratch.path().join(name);
    let file = File::create(&path).map_err(|cause| ExperimentError::file(&path, cause))?;
    let run = Command::new("xz").arg("-dc").arg(&packed).stdin(Stdio::null()).stdout(file).status();
    match run {
        Ok(status) if status.success() => Ok(path),
        Ok(status) => Err(ExperimentError::file(packed, format!("xz ended with {status}"))),
        Err(cause) => {
            let cause = format!("the command xz cannot be run: {cause}; install it or unpack the file");
            Err(ExperimentError::file(packed, cause))
        }
    }
}
