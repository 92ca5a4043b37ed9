//! What is asked of a run.

use serde::Serialize;

use crate::{Figures, Trajectory};

/// Largest APE of a run with a fault, metres.
const APE_LIMIT_M: f64 = 0.2;
/// Time in which a lost odometry must recover, seconds.
const RECOVERY_LIMIT_S: f64 = 5.0;
/// Largest jump between two frames, metres.
const JUMP_LIMIT_M: f64 = 0.3;

/// Whether a run with a fault holds what is asked of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// APE within 0.2 m, no jump over 0.3 m.
    Held,
    /// "Lost" was said before the error passed 0.5 m, it was over within 5 s, every stretch beside it has an APE within 0.2 m,
    /// and there was no jump over 0.3 m.
    Recovered,
    /// A stage refused the data and said why.
    Refused,
    /// None of these.
    Failed,
}

impl Verdict {
    /// Judges a run.
    pub fn of(run: &Trajectory, figures: &Figures) -> Self {
        if run.refused.is_some() {
            return Self::Refused;
        }
        let losses = &figures.losses;
        let recovered = losses.times > 0
            && losses.said_in_time
            && losses.recovery_s <= RECOVERY_LIMIT_S
            && losses.stretch_ape_m <= APE_LIMIT_M;
        if figures.frames == 0 || figures.jump_m > JUMP_LIMIT_M {
            Self::Failed
        } else if figures.ape_m <= APE_LIMIT_M {
            Self::Held
        } else if recovered {
            Self::Recovered
        } else {
            Self::Failed
        }
    }

    /// In one word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Held => "held",
            Self::Recovered => "recovered",
            Self::Refused => "refused",
            Self::Failed => "failed",
        }
    }
}
