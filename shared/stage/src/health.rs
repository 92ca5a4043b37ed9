//! A stage's report about itself: counters and latency percentiles, each second and once at its end.

use evac_frames::{DeviceHealth, FrameHeader, Health, LatencySummary, NO_SEQ, OdometryHealth, StageState};
use evac_ports::services::HealthStatus;
use evac_ports::{Bus, PortError, RecordPublisher, now_ns};
use hdrhistogram::Histogram;

use crate::Counters;
use crate::tracer::Tracer;

/// Time between two reports.
const INTERVAL_NS: i64 = 1_000_000_000;

/// Counts and times what a stage does and publishes it on `health/status`.
#[derive(Debug)]
pub struct Reporter {
    /// None where nobody is listening: in tests and benches.
    publisher: Option<RecordPublisher<HealthStatus>>,
    health: Health,
    ipc: Latency,
    compute: Latency,
    end_to_end: Latency,
    /// A processor's or consumer's.
    pub(crate) tracer: Option<Tracer>,
    /// What came in.
    pub input: InputCounters,
    /// What the stage itself counts.
    pub counters: Counters,
    /// How the odometry fares, where the stage is one.
    pub odometry: OdometryHealth,
    /// How the device fares, where the stage is a driver.
    pub device: DeviceHealth,
    last_report: (i64, u64),
}

/// What the joining of streams counts.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct InputCounters {
    /// Frames that never came.
    pub lost: u64,
    /// Frames that came too late for their partner, or came twice, or were handed on without a partner that did not come in
    /// time.
    pub late: u64,
    /// IMU samples that never came.
    pub imu_lost: u64,
    /// IMU samples that came twice, were not in the order of time, or were not finite.
    pub imu_rejected: u64,
}

impl Reporter {
    /// Opens the health service and says that the stage is waiting.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, name: &str, epoch: u32) -> Result<Self, PortError> {
        Self::open_as(bus, name, epoch, StageState::Waiting)
    }

    pub(crate) fn open_as(bus: &Bus, name: &str, epoch: u32, state: StageState) -> Result<Self, PortError> {
        let mut reporter = Self::detached();
        reporter.publisher = Some(RecordPublisher::open(bus)?);
        reporter.health.name = Health::text(name);
        reporter.health.epoch = epoch;
        reporter.health.state = state as u32;
        reporter.publish()?;
        Ok(reporter)
    }

    /// A reporter that publishes nothing, for tests and benches.
    pub fn detached() -> Self {
        let state = StageState::Waiting as u32;
        Self {
            publisher: None,
            health: Health { pid: std::process::id(), state, ..Health::default() },
            ipc: Latency::new(),
            compute: Latency::new(),
            end_to_end: Latency::new(),
            tracer: None,
            input: InputCounters::default(),
            counters: Counters::default(),
            odometry: OdometryHealth::default(),
            device: DeviceHealth::default(),
            last_report: (now_ns(), 0),
        }
    }

    /// What goes on, in words for an operator; stays in the reports until the next one. Empty: nothing to say.
    pub fn note(&mut self, text: &str) {
        self.health.reason = Health::text(text);
    }

    /// The newest note.
    pub fn noted(&self) -> String {
        Health::text_of(&self.health.reason)
    }

    /// A frame came in from another process.
    pub fn received(&mut self, sent_ns: i64) {
        self.health.last_input_ns = now_ns();
        self.ipc.record(self.health.last_input_ns - sent_ns);
        if let Some(tracer) = &mut self.tracer {
            tracer.received(sent_ns, self.health.last_input_ns);
        }
    }

    /// A frame with all its partners is about to be processed.
    pub fn begin(&mut self) {
        self.health.frames_in += 1;
        if self.health.state == StageState::Waiting as u32 {
            self.health.state = StageState::Running as u32;
        }
    }

    /// The frame that `begin` announced is done; `complete_ns` is when its last partner had come.
    pub fn done(&mut self, header: &FrameHeader, complete_ns: i64) {
        let now = now_ns();
        self.health.frames_out += 1;
        self.health.last_seq = header.seq;
        self.compute.record(now - complete_ns);
        self.end_to_end.record(now - header.arrival_ns);
        if let Some(tracer) = &self.tracer {
            tracer.done(header, complete_ns, now);
        }
    }

    /// A standby is done with frame `seq` of the routed instance.
    pub(crate) fn followed(&mut self, seq: u64) {
        self.health.frames_in += 1;
        self.health.last_seq = seq;
    }

    /// What a standby counted while it followed is no business of whoever reads it from now on.
    pub(crate) fn forget(&mut self) {
        (self.input, self.counters) = (InputCounters::default(), Counters::default());
        self.health.frames_in = 0;
        self.last_report = (now_ns(), 0);
        for latency in [&mut self.ipc, &mut self.compute, &mut self.end_to_end] {
            latency.clear();
        }
    }

    /// Publishes a report at once where the state is another than before.
    pub(crate) fn change(&mut self, state: StageState) -> Result<(), PortError> {
        if self.health.state == state as u32 {
            return Ok(());
        }
        self.health.state = state as u32;
        self.publish()
    }

    /// Says which frame was the last before another instance takes over; without one, `NO_SEQ`.
    pub(crate) fn retire(&mut self, last_seq: Option<u64>) -> Result<(), PortError> {
        self.health.last_seq = last_seq.unwrap_or(NO_SEQ);
        self.health.state = StageState::Retired as u32;
        self.publish()
    }

    /// How many frames the whole stream will have.
    pub fn expect(&mut self, total: Option<u64>) {
        self.health.total = total.unwrap_or(0);
    }

    /// Publishes a report if one is due; returns nanoseconds until the next.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn report_if_due(&mut self) -> Result<i64, PortError> {
        let due = self.last_report.0 + INTERVAL_NS - now_ns();
        if due > 0 {
            return Ok(due);
        }
        self.publish()?;
        Ok(INTERVAL_NS)
    }

    /// Publishes a last report with the final state and, where it failed, the reason.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn end(&mut self, state: StageState, reason: &str) -> Result<(), PortError> {
        self.health.state = state as u32;
        self.health.reason = Health::text(reason);
        self.publish()
    }

    fn publish(&mut self) -> Result<(), PortError> {
        let now = now_ns();
        let (then, frames) = self.last_report;
        let elapsed = now - then;
        // A report out of turn (the last one) keeps the rate: over a short time it would be noise.
        if elapsed >= INTERVAL_NS / 2 {
            let arrived = (self.health.frames_in - frames) as f64;
            self.health.rate_millihertz = (arrived * 1e12 / elapsed as f64).round() as u64;
            self.last_report = (now, self.health.frames_in);
        }
        self.health.reported_ns = now;
        self.health.lost = self.input.lost;
        self.health.late = self.input.late + self.counters.late;
        self.health.degraded = self.counters.degraded;
        self.health.rejected = self.counters.rejected + self.input.imu_rejected;
        self.health.imu_lost = self.input.imu_lost;
        self.health.odometry = self.odometry;
        self.health.device = self.device;
        self.health.ipc = self.ipc.summary();
        self.health.compute = self.compute.summary();
        self.health.end_to_end = self.end_to_end.summary();
        self.publisher.as_ref().map_or(Ok(()), |publisher| publisher.publish(&self.health))
    }
}

/// A histogram from 1 us to 100 s with 1 % resolution; everything is allocated at the start.
#[derive(Debug)]
struct Latency(Option<Histogram<u32>>);

impl Latency {
    fn new() -> Self {
        // The bounds are constants that the histogram accepts; without it the report would say count 0.
        Self(Histogram::new_with_bounds(1_000, 100_000_000_000, 2).ok())
    }

    fn record(&mut self, nanoseconds: i64) {
        if let Some(histogram) = &mut self.0 {
            histogram.saturating_record(nanoseconds.max(0).unsigned_abs());
        }
    }

    fn clear(&mut self) {
        if let Some(histogram) = &mut self.0 {
            histogram.reset();
        }
    }

    fn summary(&self) -> LatencySummary {
        self.0.as_ref().map_or_else(LatencySummary::default, |histogram| LatencySummary {
            count: histogram.len(),
            p50_ns: histogram.value_at_quantile(0.5),
            p99_ns: histogram.value_at_quantile(0.99),
            max_ns: histogram.max(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_values() {
        let mut latency = Latency::new();
        for ms in 1..=100 {
            latency.record(ms * 1_000_000);
        }
        let summary = latency.summary();
        assert_eq!(summary.count, 100);
        for (value, expected) in [(summary.p50_ns, 50e6), (summary.p99_ns, 99e6), (summary.max_ns, 100e6)] {
            assert!((value as f64 / expected - 1.0).abs() < 0.02, "{value} {expected}");
        }
    }
}
