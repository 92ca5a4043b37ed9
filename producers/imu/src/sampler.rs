//! From frames to samples with times.

use std::collections::VecDeque;

use evac_clock::{ClockFit, Quality, Settings};
use evac_formats::wt901c::{Assembler, FRAME_BYTES, Frame, RawSample, Reading, Scales, content};
use evac_frames::{ImuAttitude, ImuSample, attitude_flags};

use crate::Config;

/// The rate is measured over so many samples, and at least a second.
const MEASURED_SAMPLES: u64 = 20;
const MEASURED_NS: i64 = 1_000_000_000;
/// A measured rate that is within this share of the nominal one is the nominal one with a clock that is off: arrivals alone do not
/// tell a second's rate better.
const RATE_TOLERANCE: f64 = 0.02;
/// A pause of arrivals after which the count of samples means nothing, nanoseconds and periods.
const PAUSE_NS: i64 = 100_000_000;
const PAUSE_PERIODS: f64 = 20.0;
/// The module's clock and its samples may disagree by this much before it is called a step, nanoseconds.
const CLOCK_STEP_NS: i64 = 100_000_000;

/// Samples that wait for their times are kept for so long, seconds: the clock settles in 1.5, and begins anew at most once where the
/// rate is another than the nominal one, which is measured in one.
const KEPT_S: f64 = 4.0;

/// What raw words stand for.
pub(crate) fn scales(config: &Config) -> Scales {
    Scales {
        accel: config.accel_range_g * config.one_g_m_s2 / 32768.0,
        gyro: config.gyro_range_dps.to_radians() / 32768.0,
    }
}

/// What a sampler has counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct SamplerCounts {
    /// Whole samples.
    pub(crate) whole: u64,
    /// Samples that the module took and that did not arrive whole.
    pub(crate) lost: u64,
    /// Samples whose time never became known.
    pub(crate) untimed: u64,
    /// Steps of the module's clock.
    pub(crate) clock_steps: u64,
    /// Size of the newest, nanoseconds.
    pub(crate) newest_step_ns: i64,
    /// Times that the count of samples had to begin anew: pauses, and losses that nothing else showed.
    pub(crate) restarts: u64,
}

/// Puts frames together, counts samples, and times them by the count.
#[derive(Debug)]
pub(crate) struct Sampler {
    assembler: Assembler,
    scales: Scales,
    nominal_ns: f64,
    /// Bytes of a sample, and of it those up to the gyroscope's last.
    group_bytes: u64,
    lead_bytes: f64,
    byte_ns: f64,
    rate: Rate,
    fit: ClockFit,
    /// Period that `fit` is for.
    period_ns: f64,
    last_stamp_ns: i64,
    index: u64,
    last: Option<(RawSample, i64)>,
    /// Samples whose time will be known when the clock has settled, oldest first.
    waiting: VecDeque<Waiting>,
    /// Samples with times, and what else has come of each already.
    ready: VecDeque<(ImuSample, Option<ImuAttitude>)>,
    /// What has come of the newest published sample's other frames, and what makes it complete.
    attitude: ImuAttitude,
    attitude_complete: u32,
    pub(crate) counts: SamplerCounts,
}

/// A sample without a time.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    raw: RawSample,
    byte_ns: i64,
    arrival_ns: i64,
    index: u64,
    /// What has come of its other frames.
    attitude: ImuAttitude,
}

/// How many samples come in a second.
#[derive(Debug, Clone, Copy)]
enum Rate {
    Measuring { samples: u64, since: Option<(RawSample, i64)> },
    Known,
}

impl Sampler {
    pub(crate) fn new(config: &Config) -> Self {
        let frames = config.content();
        let before = 2 + u64::from(frames & content::TIME != 0);
        let kept = (config.rate_hz * KEPT_S) as usize;
        Self {
            assembler: Assembler::default(),
            scales: scales(config),
            nominal_ns: 1e9 / config.rate_hz,
            group_bytes: u64::from(frames.count_ones()) * FRAME_BYTES as u64,
            lead_bytes: (before * FRAME_BYTES as u64) as f64,
            byte_ns: 0.0,
            rate: Rate::Measuring { samples: 0, since: None },
            fit: ClockFit::new(Settings::samples(config.rate_hz)),
            period_ns: 1e9 / config.rate_hz,
            last_stamp_ns: i64::MIN,
            index: 0,
            last: None,
            waiting: VecDeque::with_capacity(kept),
            ready: VecDeque::with_capacity(kept + 1),
            attitude: ImuAttitude::default(),
            attitude_complete: attitude_of(frames),
            counts: SamplerCounts::default(),
        }
    }

    /// A stream begins, on a line of this speed.
    pub(crate) fn begin(&mut self, baud: u32) {
        self.byte_ns = 1e10 / f64::from(baud);
        self.rate = Rate::Measuring { samples: 0, since: None };
        self.assembler = Assembler::default();
        self.last = None;
        // The count begins anew: their places in it are lost.
        self.counts.untimed += self.waiting.len() as u64;
        self.waiting.clear();
        // What was learnt about the clock's rate stays.
        self.fit.restart();
        if self.period_ns != self.nominal_ns {
            self.fit = ClockFit::new(Settings::samples(1e9 / self.nominal_ns));
            self.period_ns = self.nominal_ns;
        }
    }

    /// Samples per second, by the host's clock; `None` before it is known.
    pub(crate) fn rate_hz(&self) -> Option<f64> {
        let slower = 1.0 + self.fit.quality().drift_ppm * 1e-6;
        matches!(self.rate, Rate::Known).then(|| 1e9 / (self.period_ns * slower))
    }

    pub(crate) fn quality(&self) -> Quality {
        self.fit.quality()
    }

    /// Takes in a frame whose last byte came at `byte_ns` at the latest, read at `arrival_ns`. What it gives is fetched with
    /// [`Self::pop`].
    pub(crate) fn push(&mut self, frame: &Frame, byte_ns: i64, arrival_ns: i64) {
        let Some(raw) = self.assembler.push(frame) else { return };
        self.counts.whole += 1;
        if self.measure(raw, byte_ns) {
            self.time_anew();
        }
        self.time(Waiting { raw, byte_ns, arrival_ns, index: 0, attitude: ImuAttitude::default() });
    }

    /// The next sample whose time is known. At a stream's start the first ones come together, when the clock has settled, with what
    /// [`Self::push_other`] would have given of each.
    pub(crate) fn pop(&mut self) -> Option<(ImuSample, Option<ImuAttitude>)> {
        self.ready.pop_front()
    }

    /// Counts a sample and times it, and with it those that waited; or lets it wait.
    fn time(&mut self, sample: Waiting) {
        self.count(&sample.raw, sample.byte_ns, self.period_ns);
        self.last = Some((sample.raw, sample.byte_ns));
        let seen = self.fit.observe(self.index, sample.byte_ns);
        if seen.step.is_some() {
            self.counts.restarts += 1;
            self.give_up(usize::MAX);
        }
        let Some(stamp_ns) = seen.stamp_ns else {
            // In the middle of a stream it is in doubt, and no later one will say more.
            let settled = self.fit.host_ns(self.index).is_some();
            self.give_up(if settled || self.waiting.len() < self.waiting.capacity() { 0 } else { 1 });
            self.counts.untimed += u64::from(settled);
            if !settled {
                self.waiting.push_back(Waiting { index: self.index, ..sample });
            }
            return;
        };
        while let Some(waiting) = self.waiting.pop_front() {
            let earlier_ns = self.fit.host_ns(waiting.index).filter(|earlier_ns| *earlier_ns < stamp_ns);
            self.publish(&waiting, earlier_ns);
        }
        self.publish(&sample, Some(stamp_ns));
    }

    /// The rate is another one: what has waited is counted and timed by it.
    fn time_anew(&mut self) {
        self.last = None;
        for _ in 0..self.waiting.len() {
            if let Some(waiting) = self.waiting.pop_front() {
                self.time(waiting);
            }
        }
    }

    /// Lets go of the oldest ones that wait.
    fn give_up(&mut self, most: usize) {
        let given_up = self.waiting.drain(..most.min(self.waiting.len())).count();
        self.counts.untimed += given_up as u64;
    }

    fn publish(&mut self, sample: &Waiting, stamp_ns: Option<i64>) {
        let Some(stamp_ns) = stamp_ns.filter(|stamp_ns| *stamp_ns > self.last_stamp_ns) else {
            self.counts.untimed += 1;
            return;
        };
        self.last_stamp_ns = stamp_ns;
        // When the module began to send it.
        let stamp_ns = stamp_ns - (self.lead_bytes * self.byte_ns) as i64;
        let arrival_ns = sample.arrival_ns;
        self.attitude = ImuAttitude { stamp_ns, arrival_ns, ..ImuAttitude::default() };
        let attitude = ImuAttitude { stamp_ns, arrival_ns, ..sample.attitude };
        let is_complete = attitude.contains != 0 && attitude.contains == self.attitude_complete;
        let timed = ImuSample {
            stamp_ns,
            arrival_ns,
            gyro: self.scales.gyro(sample.raw.gyro),
            accel: self.scales.accel(sample.raw.accel),
            ..ImuSample::default()
        };
        self.ready.push_back((timed, is_complete.then_some(attitude)));
    }

    /// Takes in a frame that is no part of a sample: angles, magnetic field or quaternion, which follow it; all of them together
    /// once the last has come. Where one is lost the others are too.
    pub(crate) fn push_other(&mut self, frame: &Frame) -> Option<ImuAttitude> {
        let belongs = self.last.is_some_and(|(raw, _)| {
            frame.offset.wrapping_sub(raw.offset) < self.group_bytes + FRAME_BYTES as u64
        });
        if !belongs {
            return None;
        }
        // The newest sample's, which may have to wait for its time.
        let attitude = self.waiting.back_mut().map_or(&mut self.attitude, |waiting| &mut waiting.attitude);
        let bit = match frame.reading(&self.scales)? {
            Reading::Angles { roll_pitch_yaw, .. } => {
                attitude.roll_pitch_yaw = roll_pitch_yaw;
                attitude_flags::ANGLES
            }
            Reading::Magnetometer(field) => {
                attitude.magnetic_field = field.map(f64::from);
                attitude_flags::MAGNETIC_FIELD
            }
            // The vendor's q0 is the scalar.
            Reading::Quaternion([w, x, y, z]) => {
                attitude.orientation = [x, y, z, w];
                attitude_flags::ORIENTATION
            }
            _ => return None,
        };
        attitude.contains |= bit;
        let complete = attitude.contains == self.attitude_complete && attitude.stamp_ns != 0;
        complete.then(|| std::mem::take(attitude))
    }

    /// Measures the rate at a stream's start; whether it is another than was thought.
    fn measure(&mut self, raw: RawSample, byte_ns: i64) -> bool {
        let Rate::Measuring { samples, since } = &mut self.rate else { return false };
        let (first, first_ns) = *since.get_or_insert((raw, byte_ns));
        *samples += 1;
        let elapsed_ns = byte_ns - first_ns;
        if *samples <= MEASURED_SAMPLES || elapsed_ns < MEASURED_NS {
            return false;
        }
        // By the module's clock where it is sane: arrivals come in lumps.
        let own_ns = first.time_ns.zip(raw.time_ns).map(|(first, last)| last - first);
        let own_ns = own_ns.filter(|own| (own - elapsed_ns).abs() < CLOCK_STEP_NS);
        let measured_ns = own_ns.unwrap_or(elapsed_ns) as f64 / (*samples - 1) as f64;
        let off = measured_ns / self.nominal_ns - 1.0;
        let period_ns = if off.abs() < RATE_TOLERANCE { self.nominal_ns } else { measured_ns };
        self.rate = Rate::Known;
        let changed = self.period_ns != period_ns;
        if changed {
            self.fit = ClockFit::new(Settings::samples(1e9 / period_ns));
            self.period_ns = period_ns;
        }
        changed
    }

    /// Moves the count on to `raw`: by its time on the module's clock, or by the bytes since the sample before.
    fn count(&mut self, raw: &RawSample, byte_ns: i64, period_ns: f64) {
        let Some((last, last_ns)) = self.last else { return };
        let pause_ns = PAUSE_NS.max((PAUSE_PERIODS * period_ns) as i64);
        let by_bytes = ((raw.offset - last.offset) as f64 / self.group_bytes as f64).round().max(1.0);
        let by_time = last.time_ns.zip(raw.time_ns).map(|(last, now)| (now - last) as f64 / period_ns);
        let silent_ns = byte_ns - last_ns;
        let mut steps = by_bytes;
        if let Some(by_time) = by_time {
            let host = silent_ns as f64 / period_ns;
            let disagrees = |a: f64, b: f64| (a - b).abs() * period_ns > CLOCK_STEP_NS as f64;
            if disagrees(by_time, host) && disagrees(by_time, by_bytes) {
                self.counts.clock_steps += 1;
                self.counts.newest_step_ns = ((by_time - by_bytes) * period_ns) as i64;
            } else {
                steps = by_time.round().max(1.0);
            }
        } else if silent_ns > pause_ns {
            self.fit.restart();
            self.counts.restarts += 1;
        }
        self.index += steps as u64;
        self.counts.lost += steps as u64 - 1;
    }
}

/// The flags that all frames of a content together set.
fn attitude_of(frames: u16) -> u32 {
    let parts = [
        (content::ANGLE, attitude_flags::ANGLES),
        (content::MAGNETOMETER, attitude_flags::MAGNETIC_FIELD),
        (content::QUATERNION, attitude_flags::ORIENTATION),
    ];
    parts.iter().filter(|(frame, _)| frames & frame != 0).fold(0, |all, (_, flag)| all | flag)
}

#[cfg(test)]
mod tests;
