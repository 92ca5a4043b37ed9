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
/// From one scan to the next at most a quarter of the view is new: a share of this times the last one is no change of view.
const SUDDEN_SHARE: f64 = 0.15;
const WEAK_FRAMES: u32 = 3;
/// ... if the last one was at least this.
const SEEN_SHARE: f64 = 0.5;
/// What stands before the sensor takes away all but so much of what was seen before it ...
const BLOCKED_SHARE: f64 = 0.4;
/// ... which may have been little, as on stairs ...
const HIDDEN_FROM: f64 = 0.2;
/// ... and is nearer than so much of what is usually seen.
const NEAR_SHARE: f64 = 0.6;
/// Longest time that the IMU alone is gone by.
const BLOCKED_FRAMES: u32 = 50;
/// Share of the selected points that must see planes before a bad match counts.
const VIEW_SHARE: f64 = 0.3;
/// Signs of a recovery.
const FOUND_SHARE: f64 = 0.6;
const FOUND_RESIDUAL: f64 = 1.8;
const FOUND_FRAMES: u32 = 5;
/// After so many frames without recovery the map is started anew from where dead reckoning says.
const RESTART_FRAMES: u32 = 30;
/// ... of which at least so many saw more than a blank wall at the end.
const SEARCH_FRAMES: u32 = 10;
/// A position more certain than this is known again, metres (standard deviation).
const PLACED: f64 = 0.1;
/// A position less certain than this is of no use, metres (standard deviation).
pub(crate) const ADRIFT: f64 = 0.4;

/// What to do with the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Use it and map it.
    Good,
    /// Use what little there is of it, but do not map it.
    Doubtful,
    /// Something hides the view: go by the IMU alone.
    Blocked,
    /// Nothing fits, which is no wonder where the position has become so uncertain: start a new map from there.
    Adrift,
    /// The match has just been lost.
    JustLost,
    /// Still lost.
    Lost,
    /// Lost for too long: start a new map.
    Restart,
}

/// What makes a frame's surprise no sign of trouble.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Expected {
    /// Directions are not observed: their surprise says nothing, if it is not large.
    pub(crate) degenerate: bool,
    /// The pose comes back to an older section of the map.
    pub(crate) returning: bool,
    /// Scans are missing before this one: it may see what none has seen.
    pub(crate) after_gap: bool,
    /// Mean range of the scan's points, metres.
    pub(crate) range_m: f64,
    /// Standard deviation of the position in its least certain direction, metres.
    pub(crate) position_sigma: f64,
    /// More than one direction is not observed: before a blank wall.
    pub(crate) is_blank: bool,
    /// Before the match the position was of no use.
    pub(crate) is_adrift: bool,
}

/// Memory of the frames before.
#[derive(Debug, Default)]
pub(crate) struct Monitor {
    nis: f64,
    /// Mean share of the selected points that good frames use.
    usual_share: f64,
    /// The same share of the last good frame.
    recent_share: f64,
    /// Mean range of good frames, metres.
    usual_range_m: f64,
    weak: u32,
    frames_blocked: u32,
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
        expected: Expected,
        state: &State,
        config: &LioConfig,
    ) -> Verdict {
        let selected = report.selected.max(1) as f64;
        let in_view = report.in_view as f64;
        let share = report.used as f64 / in_view.max(1.0);
        let viewed = in_view / selected > VIEW_SHARE && report.selected > 100;
        if !expected.returning && (!expected.degenerate || report.nis > LOST_NIS) {
            let rate = if report.nis > self.nis { RISE } else { FALL };
            self.nis += rate * (report.nis.min(100.0) - self.nis);
        }
        let possible =
            state.velocity.norm() <= config.max_speed_m_s && state.accel_bias.norm() <= MAX_ACCEL_BIAS;
        let used_share = report.used as f64 / selected;
        // A false match sees few planes, and agrees with those; before a blank wall any place fits.
        let found = share > FOUND_SHARE && used_share > FOUND_SHARE * self.usual_share;
        if self.lost {
            // Before a blank wall that fits there is nothing to give up; a new map would begin no better there. What is in view once it
            // is passed is found soon or not at all.
            let is_held_up = expected.is_blank && viewed && share > FOUND_SHARE;
            let limit = if is_held_up { RESTART_FRAMES - SEARCH_FRAMES } else { RESTART_FRAMES };
            self.frames_lost = (self.frames_lost + 1).min(limit.max(self.frames_lost));
            let is_placed = expected.position_sigma < PLACED;
            return self
                .while_lost(viewed && found && report.residual < FOUND_RESIDUAL && possible && is_placed);
        }
        // Something stands before the sensor: nothing says that the pose is wrong.
        let falls_to =
            |share: f64, from: f64| self.recent_share > from && used_share < share * self.recent_share;
        let is_near = expected.range_m < NEAR_SHARE * self.usual_range_m;
        if possible && is_near && falls_to(BLOCKED_SHARE, HIDDEN_FROM) && self.frames_blocked < BLOCKED_FRAMES
        {
            self.frames_blocked += 1;
            return Verdict::Blocked;
        }
        let falls_suddenly = falls_to(SUDDEN_SHARE, SEEN_SHARE);
        let unblocked = std::mem::take(&mut self.frames_blocked) > 0;
        let sudden = !expected.after_gap && !unblocked && report.selected > 100 && falls_suddenly;
        let weak = sudden
            || viewed && (share < LOST_SHARE || report.residual > LOST_RESIDUAL)
            || expected.is_adrift && !found;
        self.weak = if weak { self.weak + 1 } else { 0 };
        if self.weak >= WEAK_FRAMES || self.nis > LOST_NIS || !possible {
            let adrift = possible && expected.is_adrift;
            *self = Self { lost: !adrift, ..self.usual() };
            return if adrift { Verdict::Adrift } else { Verdict::JustLost };
        }
        if weak {
            return Verdict::Doubtful;
        }
        self.recent_share = used_share;
        self.usual_share += FALL * (used_share - self.usual_share);
        self.usual_range_m += FALL * (expected.range_m - self.usual_range_m);
        Verdict::Good
    }

    /// What is remembered beyond a loss.
    fn usual(&self) -> Self {
        Self { usual_share: self.usual_share, usual_range_m: self.usual_range_m, ..Self::default() }
    }

    fn while_lost(&mut self, good: bool) -> Verdict {
        self.frames_found = if good { self.frames_found + 1 } else { 0 };
        if self.frames_found >= FOUND_FRAMES {
            *self = self.usual();
            return Verdict::Good;
        }
        if self.frames_lost >= RESTART_FRAMES {
            *self = Self::default();
            return Verdict::Restart;
        }
        Verdict::Lost
    }
}

#[cfg(test)]
mod tests {

    use super::*;

    fn standing() -> State {
        State::at_origin()
    }

    fn report(used: usize, residual: f64, nis: f64) -> Report {
        Report { selected: 2500, in_view: 2400, used, residual, nis, ..Report::default() }
    }

    #[test]
    fn a_bad_match_is_a_loss_after_three_frames_and_five_good_ones_end_it() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        let mut judge = |report: &Report| monitor.judge(report, Expected::default(), &standing(), &config);
        for _ in 0..50 {
            assert_eq!(judge(&report(2300, 0.9, 0.05)), Verdict::Good);
        }
        let verdicts: Vec<_> = (0..4).map(|_| judge(&report(100, 1.0, 0.05))).collect();
        assert_eq!(verdicts, [Verdict::Doubtful, Verdict::Doubtful, Verdict::JustLost, Verdict::Lost]);
        let verdicts: Vec<_> = (0..5).map(|_| judge(&report(2200, 1.2, 0.2))).collect();
        assert_eq!(verdicts[3..], [Verdict::Lost, Verdict::Good]);
    }

    #[test]
    fn where_nothing_fits_and_the_position_has_become_useless_a_new_map_begins_at_once() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        let mut judge = |report: &Report, is_adrift: bool| {
            let expected = Expected { is_adrift, ..Expected::default() };
            monitor.judge(report, expected, &standing(), &config)
        };
        for _ in 0..50 {
            judge(&report(2300, 0.9, 0.05), false);
        }
        // A third of the view agrees by chance, and would do elsewhere.
        let verdicts: Vec<_> = (0..3).map(|_| judge(&report(800, 1.0, 0.05), true)).collect();
        assert_eq!(verdicts, [Verdict::Doubtful, Verdict::Doubtful, Verdict::Adrift]);
        assert_eq!(judge(&report(2200, 1.0, 0.05), false), Verdict::Good);
    }

    #[test]
    fn a_loss_that_lasts_begins_a_new_map() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        let mut fast = standing();
        fast.velocity.x = 10.0;
        assert_eq!(
            monitor.judge(&report(2300, 0.9, 0.05), Expected::default(), &fast, &config),
            Verdict::JustLost
        );
        let verdicts: Vec<_> = (0..30)
            .map(|_| monitor.judge(&report(10, 3.0, 0.1), Expected::default(), &standing(), &config))
            .collect();
        assert!(verdicts[..29].iter().all(|verdict| *verdict == Verdict::Lost));
        assert_eq!(verdicts[29], Verdict::Restart);
        assert!(!monitor.is_lost());
    }

    #[test]
    fn what_hides_the_view_at_once_and_near_is_waited_for_but_not_for_ever() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        let mut judge = |used: usize, range_m: f64| {
            let expected = Expected { range_m, ..Expected::default() };
            monitor.judge(&report(used, 0.9, 0.05), expected, &standing(), &config)
        };
        for _ in 0..50 {
            assert_eq!(judge(2300, 4.0), Verdict::Good);
        }
        for _ in 0..BLOCKED_FRAMES {
            assert_eq!(judge(20, 0.5), Verdict::Blocked);
        }
        assert_ne!(judge(20, 0.5), Verdict::Blocked);
        // As sudden, but as far away as ever: a match that fails.
        assert_eq!(judge(2300, 4.0), Verdict::Good);
        assert_eq!(judge(20, 4.0), Verdict::Doubtful);
    }

    #[test]
    fn a_view_of_which_little_was_known_as_down_a_stair_can_be_hidden_too() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        let mut judge = |in_view: usize, range_m: f64| {
            let seen = Report { in_view, ..report(in_view, 0.9, 0.05) };
            let expected = Expected { range_m, ..Expected::default() };
            monitor.judge(&seen, expected, &standing(), &config)
        };
        for _ in 0..50 {
            assert_eq!(judge(1000, 4.0), Verdict::Good);
        }
        assert_eq!(judge(10, 0.5), Verdict::Blocked);
        // As far away as ever it is new ground.
        assert_eq!(judge(10, 4.0), Verdict::Good);
    }

    #[test]
    fn a_place_that_is_found_in_a_corridor_is_found_though_a_direction_rests_on_the_imu() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        let mut judge = |report: &Report, position_sigma: f64| {
            let expected = Expected { degenerate: true, position_sigma, ..Expected::default() };
            monitor.judge(report, expected, &standing(), &config)
        };
        for _ in 0..50 {
            judge(&report(2300, 0.9, 0.05), 0.01);
        }
        let lost: Vec<_> = (0..3).map(|_| judge(&report(100, 1.0, 0.05), 0.01)).collect();
        assert_eq!(lost.last(), Some(&Verdict::JustLost));
        // It fits, but nobody knows where along the corridor.
        assert!((0..10).all(|_| judge(&report(2200, 1.0, 0.05), 2.0 * PLACED) == Verdict::Lost));
        let found: Vec<_> = (0..5).map(|_| judge(&report(2200, 1.0, 0.05), 0.02)).collect();
        assert_eq!(found[3..], [Verdict::Lost, Verdict::Good]);
    }

    #[test]
    fn the_noise_grows_with_surprise_but_not_from_a_blind_frame() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        monitor.judge(
            &report(2300, 0.9, 3.0),
            Expected { degenerate: true, ..Expected::default() },
            &standing(),
            &config,
        );
        assert_eq!(monitor.noise_factor(), 1.0);
        monitor.judge(&report(2300, 0.9, 3.0), Expected::default(), &standing(), &config);
        assert!((monitor.noise_factor() - 16.0).abs() < 1e-9);
    }

    #[test]
    fn one_who_is_lost_before_a_wall_is_given_a_second_to_find_himself_behind_it() {
        let (mut monitor, config) = (Monitor::default(), LioConfig::default());
        let mut judge = |used: usize, is_blank: bool| {
            let expected =
                Expected { is_blank, degenerate: is_blank, position_sigma: 0.3, ..Expected::default() };
            monitor.judge(&report(used, 0.9, 0.05), expected, &standing(), &config)
        };
        for _ in 0..50 {
            judge(2300, false);
        }
        assert_eq!((0..3).map(|_| judge(100, false)).last(), Some(Verdict::JustLost));
        assert!((0..60).all(|_| judge(2300, true) == Verdict::Lost));
        let searched = (0..20).take_while(|_| judge(300, false) == Verdict::Lost).count();
        assert_eq!(searched + 1, SEARCH_FRAMES as usize);
    }
}
