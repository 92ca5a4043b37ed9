//! A device's clock on the host's.

use crate::Settings;
use crate::counter::Counter;
use crate::envelope::{Arrival, Envelope};
use crate::steps::{Step, Verdict, Watch};

/// A correction reaches the stamps at this rate at most, so that the time between two stamps stays right to a percent.
const SLEW: f64 = 0.01;
/// Share of a new arrival in the running mean of delays.
const SHARE: f64 = 0.01;

/// What an observation gave.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Observation {
    /// The device time on the host's clock, nanoseconds; the smallest delay of the way is still in it. Rises from stamp to stamp.
    /// `None` while the envelope settles, and for arrivals out of order or in doubt.
    pub stamp_ns: Option<i64>,
    /// The device's clock has jumped: a new segment begins.
    pub step: Option<Step>,
}

/// How good a fit is.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quality {
    /// By how much the device's clock is slow against the nominal rate, parts per million.
    pub drift_ppm: f64,
    /// Running mean of how much later than the envelope data arrives, nanoseconds.
    pub delay_ns: f64,
    /// Largest such delay in this segment, nanoseconds.
    pub worst_delay_ns: f64,
    /// How far the earliest arrivals lie above the line, root mean square in nanoseconds: what stamps are good to, their constant
    /// delay aside.
    pub roughness_ns: f64,
    /// Time that the fit rests on, nanoseconds.
    pub span_ns: f64,
    /// Segments begun, the first included.
    pub segments: u64,
    /// Observations out of order or in doubt, which were not used.
    pub doubtful: u64,
}

/// Fits one device's clock; see the [crate](crate).
#[derive(Debug, Clone)]
pub struct ClockFit {
    settings: Settings,
    counter: Counter,
    envelope: Envelope,
    watch: Watch,
    segment: Option<Segment>,
    last_stamp_ns: i64,
    quality: Quality,
}

/// Where a segment began, and the correction that stamps have followed so far.
#[derive(Debug, Clone, Copy)]
struct Segment {
    /// Arrival of its first observation; delays count from it.
    host_ns: i64,
    settled: bool,
    newest_place: i64,
    /// Delay that stamps use at `newest_place`.
    applied_ns: f64,
}

impl ClockFit {
    /// A clock that nothing has been heard of.
    pub fn new(settings: Settings) -> Self {
        Self {
            counter: Counter::new(settings.modulus, settings.tick_ns),
            envelope: Envelope::new(settings.window_ns as f64, settings.tolerance_ppm),
            watch: Watch::default(),
            segment: None,
            last_stamp_ns: i64::MIN,
            quality: Quality::default(),
            settings,
        }
    }

    /// Data that the device stamped with `ticks` has arrived at `host_ns` of the host's monotonic clock.
    pub fn observe(&mut self, ticks: u64, host_ns: i64) -> Observation {
        let Some(segment) = self.segment else {
            self.begin(ticks, host_ns, None);
            return Observation::default();
        };
        let place = self.counter.place(ticks, host_ns);
        let arrival = self.arrival(&segment, place, host_ns);
        let arrival_off_ns = arrival.delay_ns - self.envelope.line().at(arrival.device_ns);
        let behind = place <= segment.newest_place;
        let known_ns = (self.settings.window_ns / 8).max(self.settings.confirm_ns);
        let sure = self.envelope.span_ns() > known_ns as f64;
        let verdict = self.watch.judge(&self.settings, place, arrival_off_ns, behind, sure, host_ns);
        match verdict {
            Verdict::Fits | Verdict::Late => {
                self.counter.accept(ticks, place, host_ns);
                if verdict == Verdict::Fits {
                    self.envelope.add(arrival);
                }
                self.count(arrival_off_ns.max(0.0));
                Observation { stamp_ns: self.advance(segment, place, host_ns), step: None }
            }
            Verdict::Doubtful => {
                self.quality.doubtful += 1;
                Observation::default()
            }
            Verdict::NewSegment { off_ns, known } => {
                // Where the new envelope lies is known from the arrivals that showed the shift: this one may be later.
                self.begin(ticks, host_ns, known.then_some(off_ns - arrival_off_ns));
                Observation { stamp_ns: None, step: Some(Step { ahead_ns: -(off_ns as i64) }) }
            }
        }
    }

    /// The host's time of `ticks` near the newest observation, by the correction that stamps follow now; `None` before the
    /// first stamp of a segment.
    pub fn host_ns(&self, ticks: u64) -> Option<i64> {
        let segment = self.segment.filter(|segment| segment.settled)?;
        let newest_ns = self.device_ns(segment.newest_place);
        // Near the newest observation: at its time.
        let newest_host_ns = segment.host_ns.saturating_add((newest_ns + segment.applied_ns) as i64);
        let device_ns = self.device_ns(self.counter.place(ticks, newest_host_ns));
        let delay_ns = segment.applied_ns + self.envelope.line().slope * (device_ns - newest_ns);
        Some(segment.host_ns.saturating_add((device_ns + delay_ns).round() as i64))
    }

    /// Begins a new segment with the next observation, for a device that was away; its clock's rate stays known.
    pub fn restart(&mut self) {
        self.segment = None;
    }

    /// How good the fit is.
    pub fn quality(&self) -> Quality {
        Quality {
            drift_ppm: self.envelope.line().slope * 1e6,
            roughness_ns: self.envelope.roughness_ns(),
            span_ns: self.envelope.span_ns(),
            ..self.quality
        }
    }

    /// Begins a segment with the arrival of `ticks` at `host_ns`, which lies `-lowest_ns` above the new envelope, where that is known.
    fn begin(&mut self, ticks: u64, host_ns: i64, lowest_ns: Option<f64>) {
        self.counter.restart();
        self.counter.accept(ticks, 0, host_ns);
        self.envelope.restart();
        self.watch = Watch::default();
        let applied_ns = lowest_ns.unwrap_or(0.0);
        self.envelope.add(Arrival { device_ns: 0.0, delay_ns: applied_ns });
        self.segment = Some(Segment { host_ns, settled: lowest_ns.is_some(), newest_place: 0, applied_ns });
        self.quality.segments += 1;
        self.quality.worst_delay_ns = 0.0;
    }

    fn device_ns(&self, place: i64) -> f64 {
        place as f64 * self.settings.tick_ns
    }

    fn arrival(&self, segment: &Segment, place: i64, host_ns: i64) -> Arrival {
        let device_ns = self.device_ns(place);
        Arrival { device_ns, delay_ns: host_ns.saturating_sub(segment.host_ns) as f64 - device_ns }
    }

    fn count(&mut self, delay_ns: f64) {
        self.quality.delay_ns += SHARE * (delay_ns - self.quality.delay_ns);
        self.quality.worst_delay_ns = self.quality.worst_delay_ns.max(delay_ns);
    }

    /// Moves the segment on to `place` and gives its stamp, unless it is too early for one.
    fn advance(&mut self, mut segment: Segment, place: i64, host_ns: i64) -> Option<i64> {
        let device_ns = self.device_ns(place);
        let target_ns = self.envelope.line().at(device_ns);
        if segment.settled {
            let reach_ns = SLEW * (device_ns - self.device_ns(segment.newest_place));
            segment.applied_ns += (target_ns - segment.applied_ns).clamp(-reach_ns, reach_ns);
        } else {
            segment.applied_ns = target_ns;
            // By both clocks: data that had piled up comes at once, and a silence shows nothing.
            let seen_ns = self.envelope.span_ns().min(host_ns.saturating_sub(segment.host_ns) as f64);
            segment.settled = seen_ns >= self.settings.settle_ns as f64;
        }
        segment.newest_place = place;
        self.segment = Some(segment);
        let stamp_ns = segment.host_ns.saturating_add((device_ns + segment.applied_ns).round() as i64);
        // A new segment may lie a little before the old one's end.
        if !segment.settled || stamp_ns <= self.last_stamp_ns {
            return None;
        }
        self.last_stamp_ns = stamp_ns;
        Some(stamp_ns)
    }
}
