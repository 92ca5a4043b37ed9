//! Judges each frame's match: scales the process noise, and finds and ends a loss (design sections 4 and 5.7).

use super::config::LioConfig;
use super::correction::Report;
use super::filter::MAX_ACCEL_BIAS;
use super::state::State;

/// Exponential mean of the NIS: quick to rise, slow to fall.
const RISE: f64 = 0.4;
const FALL: f64 = 0.05;
/// Process noise is scaled by `(mean / HEALTHY)^2` within these limits.
const HEALTHY: f64 = 0.3;
const MAX_FACTOR: f64 = 400.0;
/// Signs of a loss.
const LOST_NIS: f64 = 5.0;
const LOST_SHARE: f64 = 0.1;
const LOST_RESIDUAL: f64 = 2.0;
const WEAK_FRAMES: u32 = 3;
/// Share of the selected points that must see planes before a bad match counts.
const VIEW_SHARE: f64 = 0.3;
/// Signs of a recovery.
const FOUND_SHARE: f64 = 0.6;
const FOUND_RESIDUAL: f64 = 1.8;
const FOUND_FRAMES: u32 = 5;
/// After so many frames without recovery the map is started anew from where dead reckoning says.
const RESTART_FRAMES: u32 = 30;

/// What to do with the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Use it and map it.
    Good,
    /// The match has just been lost.
    JustLost,
    /// Still lost.
    Lost,
    /// Lost for too long: start a new map.
    Restart,
}

/// Memory of the frames before.
#[derive(Debug, Default)]
pub(crate) struct Monitor {
    nis: f64,
    /// Mean share of the selected points that good frames use.
    usual_share: f64,
    weak: u32,
    lost: bool,
    frames_lost: u32,
    frames_found: u32,
}

impl Monitor {
    /// Factor on the variance of the process noise.
    pub(crate) fn noise_factor(&self) -> f64 {
        (self.nis / HEALTHY).powi(2).clamp(1.0, MAX_FACTOR)
    }

    /// Whether the match is lost.
    pub(crate) fn is_lost(&self) -> bool {
        self.lost
    }

    /// Mean NIS, for the log.
    pub(crate) fn nis(&self) -> f64 {
        self.nis
    }

    /// Takes a frame's report.
    pub(crate) fn judge(
        &mut self,
        report: &Report,
        degenerate: bool,
        state: &State,
        config: &LioConfig,
    ) -> Verdict {
        let selected = report.selected.max(1) as f64;
        let in_view = report.in_view as f64;
        let share = report.used as f64 / in_view.max(1.0);
        let viewed = in_view / selected > VIEW_SHARE && report.selected > 100;
        if !degenerate || report.nis > LOST_NIS {
            let rate = if report.nis > self.nis { RISE } else { FALL };
            self.nis += rate * (report.nis.min(100.0) - self.nis);
        }
        let impossible =
            !(state.velocity.norm() <= config.max_speed_m_s) || !(state.accel_bias.norm() <= MAX_ACCEL_BIAS);
        let used_share = report.used as f64 / selected;
        if self.lost {
            // A false match sees few planes, and agrees with those.
            let found = share > FOUND_SHARE && used_share > FOUND_SHARE * self.usual_share;
            return self.while_lost(viewed && found && report.residual < FOUND_RESIDUAL && !impossible);
        }
        let weak = viewed && (share < LOST_SHARE || report.residual > LOST_RESIDUAL);
        self.weak = if weak { self.weak + 1 } else { 0 };
        if self.weak >= WEAK_FRAMES || self.nis > LOST_NIS || impossible {
            *self = Self { lost: true, usual_share: self.usual_share, ..Self::default() };
            return Verdict::JustLost;
        }
        self.usual_share += FALL * (used_share - self.usual_share);
        Verdict::Good
    }

    fn while_lost(&mut self, good: bool) -> Verdict {
        self.frames_lost += 1;
        self.frames_found = if good { self.frames_found + 1 } else { 0 };
        if self.frames_found >= FOUND_FRAMES {
            *self = Self { usual_share: self.usual_share, ..Self::default() };
            return Verdict::Good;
        }
        if self.frames_lost >= RESTART_FRAMES {
            *self = Self::default();
            return Verdict::Restart;
        }
        Verdict::Lost
    }
}
