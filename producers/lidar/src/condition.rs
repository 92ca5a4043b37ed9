//! What an operator should know, in the 96 characters of a health report.

use std::fmt::Write as _;

use crate::driver::PacketCounts;
use crate::session::{Phase, View};

/// The sentence, made anew when something has changed.
#[derive(Debug, Default)]
pub(crate) struct Condition {
    pub(crate) text: String,
}

impl Condition {
    pub(crate) fn describe(&mut self, view: &View, counts: &PacketCounts, silent: bool) {
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
            (Phase::Sampling, _) if silent => write!(text, "no data: is UDP to this computer blocked?"),
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
