//! Judges each frame's match, and finds and ends a loss.

use super::registration::Report;

/// Signs of a bad match: few of the features that have map around them agree with it, or not well.
const WEAK_SHARE: f64 = 0.4;
const WEAK_RESIDUAL: f64 = 0.06;
/// Features with map around them before a match can be bad.
const LEAST_IN_VIEW: usize = 60;
/// Frames in a row with fewer after which dead reckoning is called a loss: where the scan has features, and where it has none.
const BLIND_FRAMES: [u32; 2] = [5, 10];
/// Bad frames in a row that are a loss, good ones that end it, and lost ones after which the map is begun anew.
const LOST_FRAMES: u32 = 3;
const FOUND_FRAMES: u32 = 5;
const RESTART_FRAMES: u32 = 15;

/// What to do with the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Use the match and map the scan.
    Good,
    /// Use neither; not yet a loss.
    Doubtful,
    /// As above and lost.
    JustLost,
    /// Lost: the match may be used, the scan must not be mapped.
    Searching,
    /// Lost, and this match is bad too.
    Lost,
    /// Lost for too long: start a new map.
    Restart,
}

/// Memory of the frames before.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Monitor {
    weak: u32,
    blind: u32,
    lost: bool,
    frames_lost: u32,
    frames_found: u32,
}

impl Monitor {
    /// Takes a frame's report; `possible` is false where the pose would make a jump.
    pub(crate) fn judge(&mut self, report: &Report, possible: bool) -> Verdict {
        let share = report.used as f64 / report.in_view.max(1) as f64;
        let seen = report.in_view >= LEAST_IN_VIEW;
        let bad = !possible || (seen && (share < WEAK_SHARE || report.residual > WEAK_RESIDUAL));
        let has_features = report.selected >= LEAST_IN_VIEW;
        if self.lost {
            // Without features there is nothing to lay a new map from.
            return self.while_lost(bad, seen, has_features);
        }
        // Only a match that fits ends a row: what fits nothing is now bad, now unseen.
        (self.weak, self.blind) =
            if seen && !bad { (0, 0) } else { (self.weak + u32::from(bad), self.blind + 1) };
        if self.weak < LOST_FRAMES && self.blind < BLIND_FRAMES[usize::from(!has_features)] {
            return if bad { Verdict::Doubtful } else { Verdict::Good };
        }
        *self = Self { lost: true, ..Self::default() };
        Verdict::JustLost
    }

    fn while_lost(&mut self, bad: bool, seen: bool, has_features: bool) -> Verdict {
        self.frames_lost += u32::from(has_features);
        // An empty view is no proof of anything.
        self.frames_found = if bad || !seen { 0 } else { self.frames_found + 1 };
        if self.frames_found >= FOUND_FRAMES {
            *self = Self::default();
            return Verdict::Good;
        }
        if self.frames_lost >= RESTART_FRAMES {
            *self = Self::default();
            return Verdict::Restart;
        }
        if bad { Verdict::Lost } else { Verdict::Searching }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(used: usize, residual: f64) -> Report {
        Report { selected: 1000, in_view: 900, used, residual, ..Report::default() }
    }

    #[test]
    fn three_bad_matches_are_a_loss_and_five_good_ones_end_it() {
        let mut monitor = Monitor::default();
        assert_eq!(monitor.judge(&report(800, 0.02), true), Verdict::Good);
        let verdicts = [0; 4].map(|_| monitor.judge(&report(200, 0.03), true));
        assert_eq!(verdicts, [Verdict::Doubtful, Verdict::Doubtful, Verdict::JustLost, Verdict::Lost]);
        let verdicts = [0; 5].map(|_| monitor.judge(&report(800, 0.02), true));
        assert_eq!(verdicts[3..], [Verdict::Searching, Verdict::Good]);
    }

    #[test]
    fn a_loss_that_lasts_begins_a_new_map() {
        let mut monitor = Monitor::default();
        for _ in 0..3 {
            monitor.judge(&report(800, 0.02), false);
        }
        assert!(monitor.lost);
        let verdicts: Vec<_> = (0..15).map(|_| monitor.judge(&report(100, 0.1), true)).collect();
        assert!(verdicts[..14].iter().all(|verdict| *verdict == Verdict::Lost));
        assert_eq!(verdicts[14], Verdict::Restart);
    }

    #[test]
    fn new_ground_without_a_map_is_no_bad_match_but_half_a_second_of_it_is_a_loss() {
        let mut monitor = Monitor::default();
        let new_ground = Report { selected: 1000, in_view: 20, ..Report::default() };
        assert!((1..BLIND_FRAMES[0]).all(|_| monitor.judge(&new_ground, true) == Verdict::Good));
        assert_eq!(monitor.judge(&new_ground, true), Verdict::JustLost);
    }

    #[test]
    fn while_nothing_is_seen_at_all_the_old_map_is_kept() {
        let mut monitor = Monitor::default();
        let verdicts: Vec<_> = (0..100).map(|_| monitor.judge(&Report::default(), true)).collect();
        assert!(!verdicts.contains(&Verdict::Restart) && verdicts.contains(&Verdict::JustLost));
        let verdicts: Vec<_> = (0..5).map(|_| monitor.judge(&report(800, 0.02), true)).collect();
        assert_eq!(verdicts.last(), Some(&Verdict::Good));
    }
}
