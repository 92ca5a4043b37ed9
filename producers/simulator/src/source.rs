//! The simulator as a producer.

use evac_frames::{Point, PoseFrame};
use evac_stage::{Rig, SensorEvent, Source, StageError};

use crate::config::Config;
use crate::mid40::SHOTS_PER_FRAME;
use crate::recording::Recording;
use crate::walk::Walk;

/// Publishes a walk as `lidar/scan`, `imu/sample` and `truth/pose`, and records it where the configuration says so.
#[derive(Debug)]
pub struct Simulator {
    walk: Walk,
    points: Vec<Point>,
    truth: Option<PoseFrame>,
    recording: Option<Recording>,
    /// Scans that are left out.
    passed_over: u64,
}

impl Source for Simulator {
    const NAME: &'static str = "simulator";
    type Config = Config;

    fn new(config: Config, rig: &Rig) -> Result<Self, StageError> {
        let walk = Walk::new(&config, rig)?;
        let recording = config.record.as_deref().map(|folder| Recording::create(folder, rig)).transpose()?;
        Ok(Self { walk, points: Vec::with_capacity(SHOTS_PER_FRAME), truth: None, recording, passed_over: 0 })
    }

    fn next_event(&mut self) -> Result<Option<SensorEvent>, StageError> {
        let scan_ns = self.walk.next_scan_ns().unwrap_or(i64::MAX);
        // Of a sample and a scan that end together the sample comes first: the scan is then covered at once.
        if self.walk.next_imu_ns().is_some_and(|stamp| stamp <= scan_ns) {
            return self.imu();
        }
        self.scan()
    }

    fn point(&mut self, index: usize) -> Point {
        self.points.get(index).copied().unwrap_or_default()
    }

    fn truth(&self) -> Option<PoseFrame> {
        self.truth
    }

    fn start_at(&mut self, first_scan: u64) {
        // A recording holds the whole walk.
        if self.recording.is_none() {
            self.passed_over = first_scan;
        }
    }

    fn total_scans(&self) -> Option<u64> {
        Some(self.walk.frames())
    }
}

impl Simulator {
    fn imu(&mut self) -> Result<Option<SensorEvent>, StageError> {
        let Some(sampled) = self.walk.next_imu() else {
            return Ok(None);
        };
        if let Some(recording) = &mut self.recording {
            recording.imu(&sampled)?;
        }
        Ok(Some(SensorEvent::Imu(sampled.sample)))
    }

    fn scan(&mut self) -> Result<Option<SensorEvent>, StageError> {
        if self.passed_over > 0 {
            self.passed_over -= 1;
            return Ok(self.walk.pass_over_scan().map(SensorEvent::Scan));
        }
        let Some((header, truth)) = self.walk.next_scan(&mut self.points) else {
            // The walk is over; a full disk shows here at the latest.
            return self.recording.take().map_or(Ok(()), Recording::finish).map(|()| None);
        };
        if let Some(recording) = &mut self.recording {
            recording.scan(&header, &self.points, &truth)?;
        }
        self.truth = Some(truth);
        Ok(Some(SensorEvent::Scan(header)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_from_which_scans_were_left_out_goes_on_as_it_would_have() {
        let config = || Config { duration_s: Some(1.5), ..Config::default() };
        let mut whole = Simulator::new(config(), &Rig::default()).unwrap();
        let mut late = Simulator::new(config(), &Rig::default()).unwrap();
        late.start_at(7);
        let mut scans = 0;
        while let Some(event) = whole.next_event().unwrap() {
            let other = late.next_event().unwrap().unwrap();
            match (event, other) {
                (SensorEvent::Imu(a), SensorEvent::Imu(b)) => assert_eq!(a, b),
                (SensorEvent::Scan(a), SensorEvent::Scan(b)) => {
                    assert_eq!(a.frame, b.frame);
                    if scans >= 7 {
                        assert_eq!((a, &whole.points), (b, &late.points));
                    }
                    scans += 1;
                }
                pair => panic!("{pair:?}"),
            }
        }
        assert!(scans > 7 && late.next_event().unwrap().is_none());
    }
}
