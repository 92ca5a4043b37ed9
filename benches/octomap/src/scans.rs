//! Scans of a simulated walk, in the map frame with the true poses.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

use clap::ValueEnum;
use evac_geometry::nalgebra::{Point3, Vector3};
use evac_simulator::{Config, FRAME_NS, SHOT_NS, WorldKind, simulate};
use evac_stage::{Rig, StageError};

/// Frames before the walker starts.
const STANDING: usize = 30;

/// Rings and shots a ring of the spinning sensor, and its rings' elevations, degrees.
const RINGS: usize = 16;
const SHOTS_PER_RING: usize = 1500;
const ELEVATION_DEG: f64 = 15.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Sensor {
    /// A Livox Mid-40: 10,000 points a scan in a cone of 38.4 degrees.
    Mid40,
    /// 16 rings of 1,500 points from -15 to 15 degrees, all around: 24,000 points a scan.
    Spinning,
}

pub(crate) struct Points {
    pub(crate) origin: [f32; 3],
    pub(crate) points: Vec<[f32; 3]>,
}

/// `count` scans, every `stride`-th frame of a walk through a hall of 50 x 30 x 8 m.
pub(crate) fn record(sensor: Sensor, count: usize, stride: usize) -> Result<Vec<Points>, StageError> {
    let seconds = (STANDING + count * stride) as f64 * FRAME_NS as f64 * 1e-9;
    let config =
        Config { world: WorldKind::OpenHall, laps: 20, duration_s: Some(seconds), ..Config::default() };
    let mut frames = simulate(&config, &Rig::default())?;
    match sensor {
        Sensor::Mid40 => {
            let walk = frames.walk().clone();
            let frames = frames.skip(STANDING).step_by(stride).take(count);
            Ok(frames
                .map(|frame| {
                    let start_ns = frame.header.frame.start_ns;
                    let returns = frame.points.iter().enumerate().filter(|(_, point)| point.is_return());
                    let place = |(shot, point): (usize, &evac_frames::Point)| {
                        let pose = walk.map_from_lidar(start_ns + shot as i64 * SHOT_NS);
                        single(pose * Point3::new(point.x, point.y, point.z).cast::<f64>())
                    };
                    let pose = walk.map_from_lidar(frame.header.frame.end_ns);
                    Points {
                        origin: single(pose.translation.vector.into()),
                        points: returns.map(place).collect(),
                    }
                })
                .collect())
        }
        Sensor::Spinning => {
            let walk = frames.walk().clone();
            drop(frames.next());
            let scan = |n: usize| {
                let start_ns = (STANDING + n * stride) as i64 * FRAME_NS;
                let mut points = Vec::with_capacity(RINGS * SHOTS_PER_RING);
                for shot in 0..SHOTS_PER_RING {
                    let turn = shot as f64 / SHOTS_PER_RING as f64;
                    let time_ns = start_ns + (turn * FRAME_NS as f64) as i64;
                    for ring in 0..RINGS {
                        let share = ring as f64 / (RINGS - 1) as f64;
                        let elevation = ((2.0 * share - 1.0) * ELEVATION_DEG).to_radians();
                        let (sine, cosine) = (turn * std::f64::consts::TAU).sin_cos();
                        let direction =
                            Vector3::new(elevation.cos() * cosine, elevation.cos() * sine, elevation.sin());
                        points.extend(walk.cast(time_ns, &direction, 100.0).map(single));
                    }
                }
                let pose = walk.map_from_lidar(start_ns + FRAME_NS);
                Points { origin: single(pose.translation.vector.into()), points }
            };
            Ok((0..count.min(walk.frames() as usize)).map(scan).collect())
        }
    }
}

fn single(point: Point3<f64>) -> [f32; 3] {
    [point.x as f32, point.y as f32, point.z as f32]
}

/// The file that `octomap.cpp` reads.
pub(crate) fn write(scans: &[Points], path: &Path) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    for scan in scans {
        let floats = |file: &mut BufWriter<File>, point: &[f32; 3]| {
            point.iter().try_for_each(|axis| file.write_all(&axis.to_le_bytes()))
        };
        floats(&mut file, &scan.origin)?;
        file.write_all(&(scan.points.len() as u32).to_le_bytes())?;
        for point in &scan.points {
            floats(&mut file, point)?;
        }
    }
    file.flush()
}
