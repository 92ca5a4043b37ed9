//! Clocks that jump.

use crate::Settings;

/// Arrivals that agree on a jump before it is believed: one or two may be damaged stamps.
const WITNESSES: u32 = 3;

/// A jump of the device's clock, or ticks that its count has lost: a new segment begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// By how much the device's clock is ahead of where it was expected, nanoseconds; negative for one that was set back
    /// or has lost ticks.
    pub ahead_ns: i64,
}

/// What an arrival says about the segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Verdict {
    /// It belongs to the segment.
    Fits,
    /// It belongs to the segment, unless it is one of many that show a shift: it says nothing about the envelope.
    Late,
    /// Damaged, out of order, or the first of a new segment: nobody knows yet.
    Doubtful,
    /// A new segment begins here, off by this much (negative: early, the clock is ahead).
    NewSegment {
        off_ns: f64,
        /// Whether that is where the new segment's envelope lies, and not only about.
        known: bool,
    },
}

/// Since when all arrivals have been late, and by how much at least.
#[derive(Debug, Clone, Copy)]
struct Lateness {
    since_ns: i64,
    least_ns: f64,
    /// Whether `least_ns` is of the second half of the time only: the first arrivals may be from before the shift.
    second_half: bool,
}

/// Watches how far arrivals lie off the envelope.
#[derive(Debug, Clone, Default)]
pub(crate) struct Watch {
    /// Newest of the arrivals that agree on a jump: how many, device place, how far off.
    jump: Option<(u32, i64, f64)>,
    late: Option<Lateness>,
}

impl Watch {
    /// Judges an arrival at `place` ticks that lies `off_ns` above the envelope (negative: below); `behind` says that its
    /// device time is not after that of the newest accepted one, `sure` that
    /// the envelope is known well enough to call an arrival late, or a little early.
    pub(crate) fn judge(
        &mut self,
        settings: &Settings,
        place: i64,
        off_ns: f64,
        behind: bool,
        sure: bool,
        host_ns: i64,
    ) -> Verdict {
        let step_ns = settings.step_ns as f64;
        let earliest_ns = if sure { settings.early_ns.min(settings.step_ns) } else { settings.step_ns };
        if behind || off_ns < -(earliest_ns as f64) {
            return self.jumped(place, off_ns, step_ns);
        }
        self.jump = None;
        if !sure || off_ns <= settings.shift_ns as f64 {
            self.late = None;
            return Verdict::Fits;
        }
        let mut late =
            self.late.unwrap_or(Lateness { since_ns: host_ns, least_ns: off_ns, second_half: false });
        let elapsed_ns = host_ns.saturating_sub(late.since_ns);
        if !late.second_half && elapsed_ns >= settings.confirm_ns / 2 {
            late = Lateness { least_ns: off_ns, second_half: true, ..late };
        }
        late.least_ns = late.least_ns.min(off_ns);
        // Data that had piled up comes at once; a shift stays.
        if elapsed_ns >= settings.confirm_ns {
            *self = Self::default();
            return Verdict::NewSegment { off_ns: late.least_ns, known: true };
        }
        self.late = Some(late);
        Verdict::Late
    }

    fn jumped(&mut self, place: i64, off_ns: f64, step_ns: f64) -> Verdict {
        let witnesses = match self.jump {
            Some((count, at, off)) if place > at && (off_ns - off).abs() < step_ns => count + 1,
            _ => 1,
        };
        if witnesses >= WITNESSES {
            *self = Self::default();
            return Verdict::NewSegment { off_ns, known: false };
        }
        self.jump = Some((witnesses, place, off_ns));
        Verdict::Doubtful
    }
}
