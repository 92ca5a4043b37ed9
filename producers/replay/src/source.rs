//! Joins scans and IMU samples in the order of time.

use evac_frames::{ImuSample, Point, PoseFrame, ScanHeader, frame_flags};
use evac_stage::{Counters, Rig, SensorEvent, Source, StageConfig, StageError};

use crate::streams::{Recording, SECOND, seconds};
use crate::{Config, bag, capture};

/// IMU samples from longer before the first scan than this are of no use to anyone and left out.
const IMU_LEAD: i64 = SECOND;

/// A recording as a [`Source`].
pub struct Replay {
    recording: Recording,
    /// The next scan and its points; its end decides which IMU samples go before it.
    scan: Option<ScanHeader>,
    points: Vec<Point>,
    /// The next IMU sample.
    sample: Option<ImuSample>,
    /// IMU samples from too long before the first scan.
    lead_in: u64,
    /// A scan that ends here or later is the last, where only a part is replayed.
    until_ns: Option<i64>,
    /// Whether the whole recording is replayed.
    whole: bool,
    /// Time of the last IMU sample that went out.
    imu_until: i64,
    /// End of the last scan, once it has gone out.
    ended: Option<i64>,
    /// The announced scan's points are still being asked for; the next one is read when they have been.
    announced: bool,
}

impl Source for Replay {
    const NAME: &'static str = "replay";
    type Config = Config;

    fn new(config: Config, _rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let recording = if config.bag.is_some() { bag::open(&config)? } else { capture::open(&config)? };
        let whole = config.start_s == 0.0 && config.duration_s == 0.0;
        let mut replay = Self {
            whole,
            until_ns: None,
            recording,
            scan: None,
            points: Vec::new(),
            sample: None,
            lead_in: 0,
            imu_until: i64::MIN,
            ended: None,
            announced: false,
        };
        replay.read_scan()?;
        replay.choose_part(&config)?;
        let start = replay.scan.map_or(i64::MIN, |scan| scan.frame.start_ns);
        replay.read_sample()?;
        while replay.sample.is_some_and(|sample| sample.stamp_ns < start.saturating_sub(IMU_LEAD)) {
            replay.read_sample()?;
            replay.lead_in += u64::from(config.start_s == 0.0);
        }
        Ok(replay)
    }

    fn next_event(&mut self) -> Result<Option<SensorEvent>, StageError> {
        if std::mem::take(&mut self.announced) {
            self.read_scan()?;
        }
        if let Some(end) = self.ended {
            // One sample from after the last scan's end, so that the IMU covers it.
            let sample = self.sample.filter(|_| self.imu_until < end);
            return match sample {
                Some(sample) => self.send(sample).map(Some),
                None => Ok(None),
            };
        }
        match (self.sample, self.scan) {
            (Some(sample), Some(scan)) if sample.stamp_ns <= scan.frame.end_ns => self.send(sample).map(Some),
            (_, Some(scan)) => {
                self.announced = true;
                if scan.frame.flags & frame_flags::END_OF_STREAM != 0 {
                    self.ended = Some(scan.frame.end_ns);
                }
                Ok(Some(SensorEvent::Scan(scan)))
            }
            (_, None) => Ok(None),
        }
    }

    fn point(&mut self, index: usize) -> Point {
        self.points.get(index).copied().unwrap_or_default()
    }

    fn truth(&self) -> Option<PoseFrame> {
        self.recording.scans.truth()
    }

    fn counters(&self) -> Counters {
        let (scans, imu) = (self.recording.scans.counters(), self.recording.imu.counters());
        Counters {
            late: scans.late + imu.late,
            degraded: scans.degraded + imu.degraded,
            rejected: scans.rejected + imu.rejected + self.lead_in,
        }
    }

    fn total_scans(&self) -> Option<u64> {
        self.whole.then(|| self.recording.scans.total())
    }
}

impl Replay {
    fn send(&mut self, sample: ImuSample) -> Result<SensorEvent, StageError> {
        self.imu_until = sample.stamp_ns;
        self.read_sample()?;
        Ok(SensorEvent::Imu(sample))
    }

    /// Goes to the first scan of the part that is wanted.
    fn choose_part(&mut self, config: &Config) -> Result<(), StageError> {
        let Some(first) = self.scan.map(|scan| scan.frame.start_ns) else { return Ok(()) };
        let from_ns = first.saturating_add((config.start_s * 1e9) as i64);
        let mut end_ns = first;
        while let Some(scan) = self.scan.filter(|scan| scan.frame.start_ns < from_ns) {
            end_ns = scan.frame.end_ns;
            self.read_scan()?;
        }
        let Some(start_ns) = self.scan.map(|scan| scan.frame.start_ns) else {
            let (start, length) = (config.start_s, seconds(end_ns - first));
            let text =
                format!("start_s = {start} leaves nothing of a recording of {length:.1} s; choose less");
            return Err(StageError::Config(text));
        };
        if config.duration_s > 0.0 {
            self.until_ns = Some(start_ns.saturating_add((config.duration_s * 1e9) as i64));
            self.mark_last();
        }
        Ok(())
    }

    fn read_scan(&mut self) -> Result<(), StageError> {
        self.scan = self.recording.scans.next_scan(&mut self.points).map_err(file)?;
        self.mark_last();
        Ok(())
    }

    fn mark_last(&mut self) {
        if let (Some(scan), Some(until_ns)) = (&mut self.scan, self.until_ns)
            && scan.frame.end_ns >= until_ns
        {
            scan.frame.flags |= frame_flags::END_OF_STREAM;
        }
    }

    fn read_sample(&mut self) -> Result<(), StageError> {
        self.sample = self.recording.imu.next_sample().map_err(file)?;
        Ok(())
    }
}

/// A reader's error as a stage's.
pub(crate) fn file(error: evac_formats::FormatError) -> StageError {
    StageError::File(error.to_string())
}
