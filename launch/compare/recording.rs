//! Both odometries over one recording, each with a deskewer of its own, as fast as they go.

use evac_experiments::{OdometryKind, Settings, Trajectory, read_replay, run};

use super::cli::CompareArgs;
use super::deviation::{POSES, of_poses};
use super::report::{Comparison, Row, Side};
use super::usage;
use crate::cli::{Odometry, RecordingArgs};
use crate::error::LaunchError;
use crate::finite::keys_of;

pub(super) fn compare(args: &CompareArgs, kinds: [Odometry; 2]) -> Result<Comparison, LaunchError> {
    let recording = recording(args);
    let rig = recording.rig()?;
    let keys = keys_of(&recording)?.into_iter().map(|(key, value)| (key.to_owned(), value));
    let replay = keys
        .collect::<toml::Table>()
        .try_into()
        .map_err(|cause: toml::de::Error| usage(format!("the recording's options: {}", cause.message())))?;
    let walk = read_replay(&recording.name(), replay, &rig, args.duration.unwrap_or(f64::INFINITY))?;
    let seconds = walk.seconds(walk.frames.len().saturating_sub(1)).max(1e-3);
    let mut runs = kinds.map(|kind| {
        let odometry = match kind {
            Odometry::Lio => OdometryKind::Lio,
            Odometry::Loam => OdometryKind::Loam,
        };
        run(&walk, &Settings { odometry, ..Settings::default() })
    });
    for trajectory in &mut runs {
        if let Some(cause) = trajectory.refused.take() {
            return Err(usage(cause));
        }
    }
    let [a, b] = &runs;
    let side = |kind: Odometry, of: &Trajectory| {
        let computed_ms: f64 = of.frames.iter().map(|frame| frame.odometry_ms).sum();
        Side {
            name: format!("{kind:?}").to_lowercase(),
            pid: None,
            // At the recording's own pace.
            cpu_percent: Some(computed_ms * 1e-3 / seconds * 100.0),
            frames: of.frames.len() as u64,
        }
    };
    let rows = a.frames.iter().zip(&b.frames).enumerate().map(|(index, (a, b))| Row {
        seq: a.pose.frame.seq,
        time_s: walk.seconds(index),
        deviation: of_poses(&a.pose, &b.pose),
        latency_ms: [a.odometry_ms, b.odometry_ms],
    });
    Ok(Comparison {
        about: recording.name(),
        sides: [side(kinds[0], a), side(kinds[1], b)],
        measures: POSES,
        latency: "computing",
        unmatched: a.frames.len().abs_diff(b.frames.len()) as u64,
        rows: rows.collect(),
    })
}

/// A file of a LiDAR's own formats or a bag, by its name.
fn recording(args: &CompareArgs) -> RecordingArgs {
    let ending = args.what.extension().map(|ending| ending.to_ascii_lowercase());
    let is_lidar = ending.is_some_and(|ending| ["pcap", "lvx", "lvx2"].iter().any(|known| ending == *known));
    let what = Some(args.what.clone());
    let (bag, lidar) = if is_lidar { (None, what) } else { (what, None) };
    RecordingArgs {
        bag,
        lidar,
        imu: args.imu.clone(),
        imu_rate: 200.0,
        imu_offset_ms: 0.0,
        allow_truncated: false,
        rig: args.rig.clone(),
    }
}
