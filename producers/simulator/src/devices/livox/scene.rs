//! What a simulated LiDAR measures.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use evac_formats::livox_sdk1::PointRecord;
use evac_frames::Point;

use crate::mid40::SHOTS_PER_FRAME;

/// Something to be measured, shot by shot.
pub trait Scene: Send {
    /// Appends `count` shots in millimetres, number `first` since the measuring began and the following; the origin where
    /// nothing comes back.
    fn shots(&mut self, first: u64, count: usize, out: &mut Vec<PointRecord>);
}

/// A wall 4 m ahead, each shot 1 mm farther left than the one before, for a second: which shot it is can be told from a point.
#[derive(Debug, Clone, Copy)]
pub struct Wall;

impl Scene for Wall {
    fn shots(&mut self, first: u64, count: usize, out: &mut Vec<PointRecord>) {
        out.extend((first..).take(count).map(|shot| PointRecord {
            values: [4000, (shot % 100_000) as i32, 1 + (shot / 100_000) as i32],
            reflectivity: 80,
            tag: 0,
        }));
    }
}

/// The scans of a walk, handed over in order ahead of time.
#[derive(Debug)]
pub struct WalkScene {
    scans: Receiver<Vec<Point>>,
    scan: Vec<Point>,
    /// Number of the scan after the one at hand.
    next: u64,
}

/// The end at which a walk's scans are put in.
#[derive(Debug, Clone)]
pub struct WalkFeed(SyncSender<Vec<Point>>);

impl WalkFeed {
    /// Puts in the next scan; gives it back where enough are waiting.
    ///
    /// # Errors
    /// The scan, to be put in later.
    pub fn put(&self, scan: Vec<Point>) -> Result<(), Vec<Point>> {
        match self.0.try_send(scan) {
            // Nobody measures any more.
            Ok(()) | Err(TrySendError::Disconnected(_)) => Ok(()),
            Err(TrySendError::Full(scan)) => Err(scan),
        }
    }
}

impl WalkScene {
    /// A scene and the end at which its scans are put in; at most `ahead` scans wait.
    pub fn new(ahead: usize) -> (WalkFeed, Self) {
        let (feed, scans) = sync_channel(ahead);
        (WalkFeed(feed), Self { scans, scan: Vec::new(), next: 0 })
    }
}

impl Scene for WalkScene {
    fn shots(&mut self, first: u64, count: usize, out: &mut Vec<PointRecord>) {
        for shot in (first..).take(count) {
            let (scan, index) = (shot / SHOTS_PER_FRAME as u64, (shot % SHOTS_PER_FRAME as u64) as usize);
            while self.next <= scan {
                // A walk that is over, or not yet simulated, gives no returns.
                self.scan = self.scans.try_recv().unwrap_or_default();
                self.next += 1;
            }
            let point = self.scan.get(index).copied().unwrap_or_default();
            out.push(PointRecord {
                values: [point.x, point.y, point.z].map(|metres| (f64::from(metres) * 1e3).round() as i32),
                reflectivity: point.reflectivity(),
                tag: 0,
            });
        }
    }
}
