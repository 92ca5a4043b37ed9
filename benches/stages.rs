//! Deskewer, odometry and octree mapper per frame, without processes or shared memory: a simulated corridor walk is kept in
//! memory and given to each stage frame by frame. See benches/README.md for what is timed.
#![allow(clippy::expect_used)] // criterion's closures cannot return errors

mod support;

use std::path::Path;
use std::time::{Duration, Instant};

use criterion::{Criterion, SamplingMode, Throughput};
use evac_config::Pipeline;
use evac_deskewer::{Deskewer, DeskewerConfig};
use evac_frames::{Point, PoseFrame, ScanHeader, TrackingState};
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::Point3;
use evac_octree::{OctreeMap, Scan, ScanOptions};
use evac_octree_mapper::{KeyFrameConfig, OctreeMapper, OctreeMapperConfig};
use evac_odometry::{Lio, LioConfig};
use evac_simulator::{Config, Frame, simulate};
use evac_stage::{
    Counters, MapOutput, PoseOutput, Rig, ScanOutput, ScanWithImu, ScanWithPose, Stage, StageError,
};

use crate::support::{Distribution, is_trial, print_heading};

/// Rig of the pipeline that `evac up` runs with the simulator.
const PIPELINE: &str = include_str!("../launch/pipelines/simulated.toml");

fn main() -> anyhow::Result<()> {
    let mut criterion = Criterion::default().configure_from_args();
    let rig = Pipeline::parse(Path::new("simulated.toml"), PIPELINE)?.rig;
    // The walker stands for the first three seconds.
    let walk = Walk::record(if is_trial() { 4.5 } else { 15.0 }, &rig)?;
    let results = [
        deskewer(&mut criterion, &walk, &rig),
        lio(&mut criterion, &walk, &rig),
        mapper(&mut criterion, "octree_mapper", &walk, &rig, KeyFrameConfig::default()),
        mapper(&mut criterion, "octree_mapper, every frame a key frame", &walk, &rig, EVERY_FRAME),
        insertion(&mut criterion, &walk)?,
    ];
    criterion.final_summary();
    print_heading("one frame, without IPC");
    for (name, times) in &results {
        if let Some(summary) = times.summary() {
            println!("{name:<34} {summary}");
        }
    }
    Ok(())
}

/// Nothing to wait for: each frame enters the map.
const EVERY_FRAME: KeyFrameConfig = KeyFrameConfig { distance_m: 0.0, angle_deg: 0.0, interval_s: 0.0 };

/// A stage's name and the time of each of its frames.
type Row = (&'static str, Distribution);

fn deskewer(criterion: &mut Criterion, walk: &Walk, rig: &Rig) -> Row {
    let new = || Deskewer::new(DeskewerConfig::default(), rig).expect("defaults fit");
    let (mut output, mut counters) = (ScanOutput::newest_only(), Counters::default());
    measure(criterion, "deskewer", walk, walk.raw_points(), new, |stage, index| {
        let prior = index.checked_sub(1).and_then(|previous| walk.poses.get(previous));
        stage.process(walk.raw[index].input(prior), &mut output, &mut counters).expect("memory is enough");
    })
}

fn lio(criterion: &mut Criterion, walk: &Walk, rig: &Rig) -> Row {
    let new = || Lio::new(LioConfig::default(), rig).expect("defaults fit");
    let (mut output, mut counters) = (PoseOutput::newest_only(), Counters::default());
    measure(criterion, "lio", walk, walk.deskewed_points(), new, |stage, index| {
        stage.process(walk.deskewed_input(index), &mut output, &mut counters).expect("memory is enough");
    })
}

fn mapper(
    criterion: &mut Criterion,
    name: &'static str,
    walk: &Walk,
    rig: &Rig,
    key_frames: KeyFrameConfig,
) -> Row {
    let config = OctreeMapperConfig { key_frames, ..OctreeMapperConfig::default() };
    let new = || OctreeMapper::new(config, rig).expect("defaults fit");
    let (mut output, mut counters) = (MapOutput::newest_only(), Counters::default());
    measure(criterion, name, walk, walk.deskewed_points(), new, |stage, index| {
        let (header, points) = &walk.deskewed[index];
        let input = ScanWithPose { header, points, pose: &walk.poses[index] };
        stage.process(input, &mut output, &mut counters).expect("memory is enough");
    })
}

/// Rays of every frame into the mapper's octree, without filters.
fn insertion(criterion: &mut Criterion, walk: &Walk) -> anyhow::Result<Row> {
    let config = OctreeMapperConfig::default();
    let map_config = config.map_config().map_err(anyhow::Error::msg)?;
    let options = ScanOptions { max_range: Some(config.max_range_m), ..ScanOptions::default() };
    let scans: Vec<_> =
        walk.deskewed.iter().zip(&walk.poses).map(|((_, points), pose)| in_map(points, pose)).collect();
    let new = || OctreeMap::new(map_config).expect("defaults fit");
    Ok(measure(criterion, "octree insertion alone", walk, walk.deskewed_points(), new, |map, index| {
        let (origin, hits) = &scans[index];
        map.insert_scan(&Scan { origin: *origin, hits, ..Scan::default() }, &options);
    }))
}

/// A scan's origin and points in the map frame.
fn in_map(points: &[Point], pose: &PoseFrame) -> ([f32; 3], Vec<[f32; 3]>) {
    let map_from_lidar = map_from_lidar(pose);
    let place = |point: &Point| {
        let place = map_from_lidar * Point3::new(point.x, point.y, point.z).cast::<f64>();
        [place.x as f32, place.y as f32, place.z as f32]
    };
    (pose.position.map(|x| x as f32), points.iter().map(place).collect())
}

/// Gives whole walks to fresh stages; criterion gets the mean time of a frame, the table gets each frame's.
fn measure<S>(
    criterion: &mut Criterion,
    name: &'static str,
    walk: &Walk,
    points: u64,
    new: impl Fn() -> S,
    mut step: impl FnMut(&mut S, usize),
) -> Row {
    let mut times = Distribution::default();
    let mut one_walk = || {
        let (mut stage, mut total) = (new(), Duration::ZERO);
        for index in 0..walk.raw.len() {
            let start = Instant::now();
            step(&mut stage, index);
            let took = start.elapsed();
            if index >= walk.first_timed {
                times.record(took.as_nanos() as i64);
                total += took;
            }
        }
        total
    };
    let mut group = criterion.benchmark_group("stages");
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(15));
    group.throughput(Throughput::Elements(points));
    group.bench_function(name, |bencher| {
        bencher.iter_custom(|walks| (0..walks).map(|_| one_walk()).sum::<Duration>() / walk.timed_frames());
    });
    group.finish();
    (name, times)
}

/// A walk with what every stage makes of it.
struct Walk {
    raw: Vec<Frame>,
    deskewed: Vec<DeskewedScan>,
    poses: Vec<PoseFrame>,
    /// Before it the odometry initialises at the standstill, which costs nearly nothing.
    first_timed: usize,
}

impl Walk {
    fn record(duration_s: f64, rig: &Rig) -> anyhow::Result<Self> {
        let config = Config { duration_s: Some(duration_s), ..Config::default() };
        let raw: Vec<_> = simulate(&config, rig)?.collect();
        let (deskewed, poses) = run_deskewer_and_lio(&raw, rig)?;
        let first_timed = poses
            .iter()
            .position(|pose| pose.tracking_state() != Some(TrackingState::Initialising))
            .ok_or_else(|| anyhow::anyhow!("the odometry did not initialise in {duration_s} s"))?;
        Ok(Self { raw, deskewed, poses, first_timed })
    }

    fn timed_frames(&self) -> u32 {
        (self.raw.len() - self.first_timed) as u32
    }

    /// Points of a timed frame as the sensor gave it, on average.
    fn raw_points(&self) -> u64 {
        self.mean(self.raw.iter().map(|frame| frame.points.len()))
    }

    /// Points of a timed frame that the deskewer kept, on average.
    fn deskewed_points(&self) -> u64 {
        self.mean(self.deskewed.iter().map(|(_, points)| points.len()))
    }

    fn mean(&self, points: impl Iterator<Item = usize>) -> u64 {
        points.skip(self.first_timed).sum::<usize>() as u64 / u64::from(self.timed_frames())
    }

    /// A deskewed scan with the IMU samples that cover it, as the odometry gets it.
    fn deskewed_input(&self, index: usize) -> ScanWithImu<'_> {
        let (header, points) = &self.deskewed[index];
        ScanWithImu { header, points, imu: &self.raw[index].imu, imu_covers: true, prior: None }
    }
}

type DeskewedScan = (ScanHeader, Vec<Point>);

/// As in a lossless pipeline: each scan is deskewed with the pose of the one before.
fn run_deskewer_and_lio(raw: &[Frame], rig: &Rig) -> Result<(Vec<DeskewedScan>, Vec<PoseFrame>), StageError> {
    let mut deskewer = Deskewer::new(DeskewerConfig::default(), rig)?;
    let mut lio = Lio::new(LioConfig::default(), rig)?;
    let (mut scans, mut poses, mut counters) =
        (ScanOutput::default(), PoseOutput::default(), Counters::default());
    for frame in raw {
        deskewer.process(frame.input(poses.memory.last()), &mut scans, &mut counters)?;
        if let Some((header, points)) = scans.memory.last() {
            let input = ScanWithImu { header, points, imu: &frame.imu, imu_covers: true, prior: None };
            lio.process(input, &mut poses, &mut counters)?;
        }
    }
    Ok((scans.memory, poses.memory))
}
