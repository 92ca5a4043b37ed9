//! What an operator should know, in the 96 characters of a health report.

use std::fmt::Write as _;

use crate::PacketCounts;
use crate::session::{Phase, View};

/// What does not come although the device measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Silence {
    None,
    /// Neither points nor samples.
    Everything,
    /// Samples of its IMU, which are wanted.
    Imu,
}

/// The sentence, made anew when something has changed.
#[derive(Debug, Default)]
pub(crate) struct Condition {
    pub(crate) text: String,
}

impl Condition {
    pub(crate) fn describe(&mut self, view: &View, counts: &PacketCounts, silence: Silence) {
        self.text.clear();
        let text = &mut self.text;
        // Writing to a string does not fail.
        let _ = match (view.phase, view.device) {
            (Phase::Searching, _) => write!(text, "no LiDAR answers: check cable, power and interface"),
            (Phase::Connecting, Some(device)) => {
                write!(text, "asking {device} for a session; it may hold an old one")
            }
            (Phase::Starting, _) => write!(text, "waiting until the LiDAR is ready"),
            (Phase::Configuring, _) => write!(text, "configuring the LiDAR"),
            (Phase::Sampling, _) if silence == Silence::Everything => {
                write!(text, "no data: is UDP to this computer blocked?")
            }
            (Phase::Sampling, _) if silence == Silence::Imu => {
                write!(text, "no IMU samples: has this LiDAR an IMU?")
            }
            _ => write!(text, "sampling"),
        };
        if let Some((what, code)) = view.refused {
            let _ = write!(text, "; refused {what} ({code})");
        }
        if let Some(complaint) = view.complaint {
            let _ = write!(text, "; {complaint}");
        }
        if let Some(lost) = view.lost {
            let _ = write!(text, "; session {}: {}", view.sessions, lost.text());
        }
        for (count, what) in [
            (counts.segments, "clock steps"),
            (counts.lost, "lost"),
            (counts.imu_lost, "IMU samples lost"),
            (counts.late, "late"),
            (counts.strangers, "of strangers"),
            (counts.damaged, "damaged"),
        ] {
            if count > 0 {
                let _ = write!(text, "; {count} {what}");
            }
        }
    }
}
