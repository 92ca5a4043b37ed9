//! What an operator should know, in one line of a health report.

use std::fmt::Write as _;

use evac_geometry::GyroScale;

use crate::rest::Finding;
use crate::sampler::SamplerCounts;
use crate::session::{Loss, Phase};

/// Longest text that a report has room for, and then some.
const ROOM: usize = 192;
/// A rate that is lower by more than this share is too low.
const RATE_TOLERANCE: f64 = 0.05;
/// An adapter that keeps bytes longer than this should be told not to, milliseconds.
const LATENCY_MS: u32 = 2;

/// Everything that a note is made from.
#[derive(Debug, Clone)]
pub(crate) struct Facts<'a> {
    pub(crate) port: &'a str,
    /// Why the port is not open; empty where it is.
    pub(crate) closed: &'a str,
    pub(crate) phase: Option<Phase>,
    pub(crate) baud: u32,
    /// Speeds that were listened at in vain, and the rubbish that came.
    pub(crate) in_vain: u32,
    pub(crate) rubbish: u64,
    pub(crate) refused: Option<u8>,
    /// Whether the module is asked for each sample.
    pub(crate) asked: bool,
    pub(crate) wanted_hz: f64,
    pub(crate) rate_hz: Option<f64>,
    pub(crate) jitter_ms: f64,
    pub(crate) drift_ppm: f64,
    pub(crate) finding: Option<Finding>,
    pub(crate) gyro: GyroScale,
    pub(crate) gyro_range_dps: f64,
    pub(crate) zeroed: bool,
    pub(crate) latency_timer_ms: Option<u32>,
    pub(crate) unplugged: u64,
    pub(crate) losses: u64,
    pub(crate) last_loss: Option<Loss>,
    pub(crate) counts: SamplerCounts,
}

/// Writes the note; the buffer is used again, so that nothing is allocated.
#[derive(Debug)]
pub(crate) struct Note(String);

impl Note {
    pub(crate) fn new() -> Self {
        Self(String::with_capacity(ROOM))
    }

    pub(crate) fn write(&mut self, facts: &Facts<'_>) -> &str {
        self.0.clear();
        // A String takes everything.
        let _ = self.state(facts).and_then(|()| self.history(facts));
        &self.0
    }

    /// How it is now, the worst first.
    fn state(&mut self, facts: &Facts<'_>) -> std::fmt::Result {
        let text = &mut self.0;
        if !facts.closed.is_empty() {
            return text.write_str(facts.closed);
        }
        match facts.phase {
            Some(Phase::Searching) | None if facts.in_vain < 9 => {
                return write!(text, "listening for a WT901C at {} baud", facts.baud);
            }
            Some(Phase::Searching) | None => {
                let (port, rubbish) = (facts.port, facts.rubbish);
                return write!(
                    text,
                    "no WT901C at any speed on {port}, {rubbish} bytes of rubbish; check its wires"
                );
            }
            Some(Phase::Setting) => return write!(text, "setting the module at {} baud", facts.baud),
            Some(Phase::Streaming) => {}
        }
        match facts.finding {
            Some(Finding::OtherRange { gravity_m_s2, range_g }) => {
                return write!(
                    text,
                    "gravity reads {gravity_m_s2:.2} m/s2: the module's range is {range_g} g, set accel_range_g"
                );
            }
            Some(Finding::WrongGravity { gravity_m_s2 }) => {
                return write!(
                    text,
                    "gravity reads {gravity_m_s2:.2} m/s2: wrong scale, calibrate the module"
                );
            }
            Some(Finding::NotUpright { tilt_deg }) => {
                return write!(
                    text,
                    "by the rig the LiDAR is tilted {tilt_deg:.0} deg: check roll_pitch_yaw_deg"
                );
            }
            Some(Finding::Right) | None => {}
        }
        match facts.gyro {
            GyroScale::Times(times) => {
                let range = facts.gyro_range_dps / times;
                return write!(
                    text,
                    "gyro reads {times:.2} times what gravity turns by: set gyro_range_dps = {range:.0}"
                );
            }
            GyroScale::Unlike => {
                return text
                    .write_str("gravity turns as no gyro scale says: gyro and accelerometer axes differ");
            }
            GyroScale::Right | GyroScale::Unknown => {}
        }
        if let Some(rate) = facts.rate_hz.filter(|rate| *rate < facts.wanted_hz * (1.0 - RATE_TOLERANCE)) {
            write!(text, "only {rate:.0} of {:.0} Hz at {} baud", facts.wanted_hz, facts.baud)?;
        } else if let Some(register) = facts.refused {
            write!(text, "the module does not take register {register:#04x}")?;
        } else if let Some(timer) = facts.latency_timer_ms.filter(|timer| *timer > LATENCY_MS) {
            write!(text, "latency_timer {timer} ms: install launch/udev")?;
        } else if facts.asked {
            write!(text, "asked {:.0} times a second", facts.wanted_hz)?;
        } else {
            let (rate, ppm) = (facts.wanted_hz, facts.drift_ppm);
            write!(text, "{rate:.0} Hz, jitter {:.2} ms, {ppm:+.0} ppm", facts.jitter_ms)?;
        }
        if facts.zeroed {
            text.write_str("; gyro auto-zero at rest")?;
        }
        Ok(())
    }

    /// What has happened since the start.
    fn history(&mut self, facts: &Facts<'_>) -> std::fmt::Result {
        let (text, counts) = (&mut self.0, &facts.counts);
        if facts.unplugged > 0 {
            write!(text, "; unplugged {}x", facts.unplugged)?;
        }
        if facts.losses > 0 {
            let why = if facts.last_loss == Some(Loss::Garbage) { "rubbish" } else { "silence" };
            write!(text, "; lost {}x ({why})", facts.losses)?;
        }
        if counts.clock_steps > 0 {
            let step_s = counts.newest_step_ns as f64 * 1e-9;
            write!(text, "; clock stepped {}x ({step_s:+.1} s)", counts.clock_steps)?;
        }
        Ok(())
    }
}
