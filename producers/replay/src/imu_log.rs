//! A WT901C's byte log as evenly sampled IMU data.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use evac_formats::FormatError;
use evac_formats::wt901c::{FRAME_BYTES, RawSample, Scales, Wt901cCounts, Wt901cReader};
use evac_frames::ImuSample;
use evac_stage::Counters;

use crate::Config;
use crate::capture::Span;
use crate::streams::{ImuStream, SECOND, imu_sample, seconds};

/// How much earlier than the LiDAR the log may end without being taken as cut off or sampled at another rate.
const MAX_SHORTFALL: i64 = SECOND;
/// Share of lost samples above which a log is refused.
const MAX_LOST: f64 = 0.1;
/// Deviation of the module's own clock from the configured rate above which the rate is taken to be wrong.
const MAX_RATE_ERROR: f64 = 0.02;

/// Sample k was measured at `start + k / rate`. Damaged samples leave a gap in k, which shows in two ways: in the number
/// of bytes between two good samples, and in the module's own time (frame 0x50) where it is logged.
pub(crate) struct ImuLog {
    reader: Wt901cReader<BufReader<File>>,
    index: SampleIndex,
    start_ns: i64,
    period_ns: f64,
    scales: Scales,
    /// Number of the next sample if none is damaged.
    expected: u64,
    damaged: u64,
}

impl ImuLog {
    /// Goes over the log once and checks that it fits the scans' span.
    pub(crate) fn open(path: &Path, scans: &Span, config: &Config) -> Result<Self, FormatError> {
        let rate = config.imu_rate_hz;
        let start_ns = scans.start_ns.saturating_add(config.imu_offset_ns());
        let survey = Survey::read(path, rate, config.allow_truncated)?;
        survey.tell(path, rate);
        survey.check(path, rate, start_ns, scans)?;
        Ok(Self {
            reader: Wt901cReader::open(path)?.tolerate_truncation(config.allow_truncated),
            index: SampleIndex::new(rate, survey.group_bytes),
            start_ns,
            period_ns: 1e9 / rate,
            scales: Scales::with_gravity(config.one_g_m_s2),
            expected: 0,
            damaged: 0,
        })
    }
}

impl ImuStream for ImuLog {
    fn next_sample(&mut self) -> Result<Option<ImuSample>, FormatError> {
        while let Some(raw) = self.reader.next_sample()? {
            let number = self.index.of(&raw);
            self.damaged += number.saturating_sub(self.expected);
            self.expected = number + 1;
            let elapsed = (number as f64 * self.period_ns).round() as i64;
            let stamp_ns = self.start_ns.saturating_add(elapsed);
            let sample = imu_sample(stamp_ns, self.scales.gyro(raw.gyro), self.scales.accel(raw.accel));
            if sample.is_some() {
                return Ok(sample);
            }
            self.damaged += 1;
        }
        Ok(None)
    }

    /// Samples that the log should hold and does not, or not whole, are rejected.
    fn counters(&self) -> Counters {
        Counters { rejected: self.damaged, ..Counters::default() }
    }
}

/// Counts samples, those that are missing included.
#[derive(Debug, Clone)]
struct SampleIndex {
    rate: f64,
    /// Bytes from one sample to the next.
    group_bytes: u64,
    /// Place and number of the last sample.
    last: Option<(u64, u64)>,
    /// Module time and number of the last sample that had one.
    timed: Option<(i64, u64)>,
}

impl SampleIndex {
    fn new(rate: f64, group_bytes: u64) -> Self {
        Self { rate, group_bytes: group_bytes.max(1), last: None, timed: None }
    }

    fn of(&mut self, sample: &RawSample) -> u64 {
        let by_bytes = match self.last {
            // A log may begin within a sample, which is then not counted.
            None => sample.offset / self.group_bytes,
            Some((offset, index)) => {
                let bytes = sample.offset.saturating_sub(offset);
                index + ((bytes + self.group_bytes / 2) / self.group_bytes).max(1)
            }
        };
        let index = self.by_time(sample).unwrap_or(by_bytes);
        self.last = Some((sample.offset, index));
        if let Some(time) = sample.time_ns {
            self.timed = Some((time, index));
        }
        index
    }

    /// The number that the module's time gives, where it makes sense: it has a resolution of 1 ms and may be set at any
    /// time.
    fn by_time(&self, sample: &RawSample) -> Option<u64> {
        let ((before, index), (_, last)) = (self.timed?, self.last?);
        let elapsed = sample.time_ns?.checked_sub(before)?;
        if self.rate > 333.0 || !(1..10 * SECOND).contains(&elapsed) {
            return None;
        }
        let counted = index + (seconds(elapsed) * self.rate).round() as u64;
        (counted > last).then_some(counted)
    }
}

/// What a log holds.
#[derive(Debug)]
struct Survey {
    counts: Wt901cCounts,
    group_bytes: u64,
    /// Samples from the first to the last, the missing ones included.
    span: u64,
    /// Rate on the module's own clock, where it is logged.
    clock_rate: Option<f64>,
}

impl Survey {
    fn read(path: &Path, rate: f64, tolerant: bool) -> Result<Self, FormatError> {
        let open = || Wt901cReader::open(path).map(|reader| reader.tolerate_truncation(tolerant));
        let group_bytes = group_bytes(open()?)?;
        let (mut reader, mut index) = (open()?, SampleIndex::new(rate, group_bytes));
        let (mut span, mut first_time, mut last_time) = (0, None, None);
        while let Some(sample) = reader.next_sample()? {
            let number = index.of(&sample);
            span = number + 1;
            if let Some(time) = sample.time_ns {
                first_time = first_time.or(Some((time, number)));
                last_time = Some((time, number));
            }
        }
        let clock_rate = first_time.zip(last_time).and_then(|((t0, n0), (t1, n1))| {
            // Over less than a second the resolution of 1 ms is too coarse.
            (t1.saturating_sub(t0) > SECOND).then(|| (n1 - n0) as f64 / seconds(t1 - t0))
        });
        Ok(Self { counts: reader.counts(), group_bytes, span, clock_rate })
    }

    fn lost(&self) -> u64 {
        self.span.saturating_sub(self.counts.samples)
    }

    fn tell(&self, path: &Path, rate: f64) {
        let (file, samples, lost) = (path.display(), self.counts.samples, self.lost());
        tracing::info!("{file}: {samples} IMU samples, {:.3} s at {rate} Hz", self.span as f64 / rate);
        if lost > 0 || self.counts.skipped > 0 {
            let skipped = self.counts.skipped;
            tracing::warn!(
                "{file}: {lost} samples are lost, {skipped} bytes belong to no frame; their times are kept"
            );
        }
        if let Some(offset) = self.counts.truncated_at {
            tracing::warn!("{file}: the log is cut off at byte {offset}; what is before is used");
        }
    }

    fn check(&self, path: &Path, rate: f64, start_ns: i64, scans: &Span) -> Result<(), FormatError> {
        let refused =
            |cause: String, remedy: &str| FormatError::malformed(path, self.counts.bytes, cause, remedy);
        let lost = self.lost();
        if lost as f64 > MAX_LOST * self.span as f64 {
            let cause = format!("{lost} of {} IMU samples are lost at {rate} Hz", self.span);
            return Err(refused(cause, "check imu_rate_hz and the serial line's speed"));
        }
        if let Some(clock) = self.clock_rate.filter(|clock| (clock / rate - 1.0).abs() > MAX_RATE_ERROR) {
            let cause = format!("the module's own time gives {clock:.1} Hz, not {rate} Hz");
            return Err(refused(cause, "set imu_rate_hz to it"));
        }
        let end_ns = start_ns.saturating_add((self.span.saturating_sub(1) as f64 * 1e9 / rate) as i64);
        if scans.end_ns.saturating_sub(end_ns) > MAX_SHORTFALL
            || start_ns.saturating_sub(scans.start_ns) > MAX_SHORTFALL
        {
            let cause = format!(
                "the IMU log covers {:.3} to {:.3} s of a LiDAR recording of {:.3} s",
                seconds(start_ns.saturating_sub(scans.start_ns)),
                seconds(end_ns.saturating_sub(scans.start_ns)),
                seconds(scans.end_ns.saturating_sub(scans.start_ns))
            );
            return Err(refused(
                cause,
                "give the whole log of the same walk, and check imu_rate_hz and imu_offset_ms",
            ));
        }
        Ok(())
    }
}

/// The most frequent distance between two samples.
fn group_bytes(mut reader: Wt901cReader<BufReader<File>>) -> Result<u64, FormatError> {
    // Larger distances are gaps; all kinds of frames together make 132 bytes.
    const LONGEST: u64 = 12 * FRAME_BYTES as u64;
    let (mut distances, mut last) = (BTreeMap::<u64, u64>::new(), None);
    while let Some(sample) = reader.next_sample()? {
        let distance = last.map_or(0, |last| sample.offset - last);
        last = Some(sample.offset);
        if (1..=LONGEST).contains(&distance) {
            *distances.entry(distance).or_default() += 1;
        }
    }
    let most = distances.iter().max_by_key(|(distance, count)| (**count, std::cmp::Reverse(**distance)));
    Ok(most.map_or(2 * FRAME_BYTES as u64, |(distance, _)| *distance))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(offset: u64, time_ms: Option<i64>) -> RawSample {
        RawSample { accel: [0; 3], gyro: [0; 3], time_ns: time_ms.map(|ms| ms * 1_000_000), offset }
    }

    #[test]
    fn damaged_bytes_leave_a_gap_in_the_count_and_keep_the_times() {
        let mut index = SampleIndex::new(200.0, 22);
        let offsets = [0, 22, 45, 88, 110, 22 * 30 + 1];
        assert_eq!(offsets.map(|offset| index.of(&sample(offset, None))), [0, 1, 2, 4, 5, 30]);
    }

    #[test]
    fn samples_that_the_module_never_sent_are_seen_in_its_time() {
        let mut index = SampleIndex::new(200.0, 33);
        let samples =
            [(11, Some(0)), (44, Some(5)), (77, None), (110, Some(30)), (143, Some(35)), (176, Some(7))];
        assert_eq!(samples.map(|(offset, ms)| index.of(&sample(offset, ms))), [0, 1, 2, 6, 7, 8]);
    }

    #[test]
    fn a_log_that_begins_within_damaged_bytes_starts_at_its_own_number() {
        assert_eq!(SampleIndex::new(200.0, 22).of(&sample(15, None)), 0);
        assert_eq!(SampleIndex::new(200.0, 22).of(&sample(22 * 3 + 4, None)), 3);
    }
}
