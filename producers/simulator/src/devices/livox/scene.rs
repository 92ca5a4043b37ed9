//! What a simulated LiDAR measures.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use evac_formats::livox_sdk1::{ImuRecord, PointRecord};
use evac_frames::Point;
use evac_geometry::STANDARD_GRAVITY;

use crate::mid40::SHOTS_PER_FRAME;
use crate::walk::Walk;

/// How long the next scan of a walk is waited for.
const PATIENCE: Duration = Duration::from_millis(50);

/// Something to be measured, shot by shot.
pub trait Scene: Send {
    /// Appends `count` shots in millimetres, number `first` since the measuring began and the following; the origin where
    /// nothing comes back. False where the scene has ended before the last of them.
    fn shots(&mut self, first: u64, count: usize, out: &mut Vec<PointRecord>) -> bool;

    /// Sample `number` of the device's own IMU since the measuring began, [`SAMPLE_NS`](crate::SAMPLE_NS) apart; numbers rise.
    /// `None` where the scene has ended.
    fn sample(&mut self, number: u64) -> Option<ImuRecord>;
}

/// A wall 4 m ahead, each shot 1 mm farther left than the one before, for a second: which shot it is can be told from a point.
#[derive(Debug, Clone, Copy)]
pub struct Wall;

impl Scene for Wall {
    fn shots(&mut self, first: u64, count: usize, out: &mut Vec<PointRecord>) -> bool {
        out.extend((first..).take(count).map(|shot| PointRecord {
            values: [4000, (shot % 100_000) as i32, 1 + (shot / 100_000) as i32],
            reflectivity: 80,
            tag: 0,
        }));
        true
    }

    /// At rest, turned by less than the eye sees: which sample it is can be told from its first rate, in 1/1000 rad/s.
    fn sample(&mut self, number: u64) -> Option<ImuRecord> {
        Some(ImuRecord { gyro: [number as f32 * 1e-3, 0.0, 0.0], accel_g: [0.0, 0.0, 1.0] })
    }
}

/// A scan with its number.
type Numbered = (u64, Vec<Point>);

/// The scans of a walk, handed over in order ahead of time.
#[derive(Debug)]
pub struct WalkScene {
    /// The samples are drawn from it.
    walk: Walk,
    /// `None` once the walk is over: nobody need wait any more to put a scan in.
    scans: Option<Receiver<Numbered>>,
    scan: Vec<Point>,
    /// Number of the scan after the one at hand.
    next: u64,
    /// Scans in the whole walk.
    total: u64,
    late: Arc<AtomicU64>,
}

/// The end at which a walk's scans are put in.
#[derive(Debug, Clone)]
pub struct WalkFeed {
    scans: SyncSender<Numbered>,
    late: Arc<AtomicU64>,
}

impl WalkFeed {
    /// Puts in a scan with its number, which rise by one; gives it back where enough are waiting.
    ///
    /// # Errors
    /// The scan, to be put in later.
    pub fn put(&self, scan: (u64, Vec<Point>)) -> Result<(), (u64, Vec<Point>)> {
        match self.scans.try_send(scan) {
            // Nobody measures any more.
            Ok(()) | Err(TrySendError::Disconnected(_)) => Ok(()),
            Err(TrySendError::Full(scan)) => Err(scan),
        }
    }

    /// Scans that were not put in when their first shot was due; they have no returns.
    pub fn late(&self) -> u64 {
        self.late.load(Ordering::Relaxed)
    }
}

impl WalkScene {
    /// The scene of a walk, and the end at which its scans are put in; at most `ahead` of them wait.
    pub fn new(ahead: usize, walk: Walk) -> (WalkFeed, Self) {
        let (sender, scans) = sync_channel(ahead);
        let late = Arc::new(AtomicU64::new(0));
        let feed = WalkFeed { scans: sender, late: Arc::clone(&late) };
        let total = walk.frames();
        (feed, Self { walk, scans: Some(scans), scan: Vec::new(), next: 0, total, late })
    }

    /// Takes the scan of a number, and leaves out those before; the ones that come after their time are left out then.
    fn take(&mut self, number: u64) {
        while self.next <= number {
            self.scan = self.wait_for(self.next).unwrap_or_else(|| {
                self.late.fetch_add(1, Ordering::Relaxed);
                Vec::new()
            });
            self.next += 1;
        }
    }

    /// The thread that simulates may be behind: waiting for it a little is better than a hole, and packets may come late.
    fn wait_for(&self, number: u64) -> Option<Vec<Point>> {
        loop {
            let (got, scan) = self.scans.as_ref()?.recv_timeout(PATIENCE).ok()?;
            if got >= number {
                return Some(scan);
            }
        }
    }
}

impl Scene for WalkScene {
    fn shots(&mut self, first: u64, count: usize, out: &mut Vec<PointRecord>) -> bool {
        for shot in (first..).take(count) {
            let (scan, index) = (shot / SHOTS_PER_FRAME as u64, (shot % SHOTS_PER_FRAME as u64) as usize);
            if scan >= self.total {
                self.scans = None;
                return false;
            }
            self.take(scan);
            let point = self.scan.get(index).copied().unwrap_or_default();
            out.push(PointRecord {
                values: [point.x, point.y, point.z].map(|metres| (f64::from(metres) * 1e3).round() as i32),
                reflectivity: point.reflectivity(),
                tag: 0,
            });
        }
        true
    }

    fn sample(&mut self, number: u64) -> Option<ImuRecord> {
        loop {
            let sample = self.walk.next_imu()?.sample;
            if sample.seq >= number {
                return Some(ImuRecord {
                    gyro: sample.gyro.map(|value| value as f32),
                    accel_g: sample.accel.map(|value| (value / STANDARD_GRAVITY) as f32),
                });
            }
        }
    }
}
