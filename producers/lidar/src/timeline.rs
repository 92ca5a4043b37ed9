//! The device's clock: one line without jumps at pulses, its segments, and its place on the host's clock.

use evac_clock::{ClockFit, Settings};

use crate::packet::TimeSource;

/// A clock that restarts with every pulse.
const PULSE_NS: i64 = 1_000_000_000;
/// Packets whose stamps lie so far back are duplicates or were overtaken; farther back the clock was set.
const LATE_NS: i64 = 20_000_000;

/// What the fit may be off.
const FIT_NS: i64 = 5_000_000;
/// No data is under way for so long.
const LONGEST_WAY_NS: i64 = 1_000_000_000;

/// What to do with a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It goes on from the last, at this time on the device's line.
    Accept(i64),
    /// The first of a new segment: the clock was set, follows another source, or the device was away.
    NewSegment,
    /// A duplicate, or overtaken.
    Late,
    /// Its time is not known yet, or damaged.
    Unsure,
}

/// Follows a device's clock.
#[derive(Debug)]
pub(crate) struct Timeline {
    fit: ClockFit,
    source: Option<TimeSource>,
    /// Newest stamp that was looked at, as the device wrote it and on the line, and when it came.
    last: Option<(i64, i64, i64)>,
    /// Newest place on the line that was accepted.
    newest: Option<i64>,
    pub(crate) segments: u64,
}

impl Timeline {
    pub(crate) fn new() -> Self {
        Self { fit: ClockFit::new(settings()), source: None, last: None, newest: None, segments: 0 }
    }

    /// The device was away: its clock may have been set to anything.
    pub(crate) fn restart(&mut self) {
        (self.source, self.last, self.newest) = (None, None, None);
    }

    /// Whether a packet stamped by `source` ends the segment, the device's clock having followed another until now. What was
    /// measured in it has its place on the host's clock until that packet is judged.
    pub(crate) fn leaves(&self, source: TimeSource) -> bool {
        self.source.is_some_and(|known| known != source)
    }

    /// Judges a packet whose first shot is stamped `stamp_ns`, which lasts `length_ns` and came at `arrival_ns`.
    pub(crate) fn judge(
        &mut self,
        source: TimeSource,
        stamp_ns: i64,
        length_ns: i64,
        arrival_ns: i64,
    ) -> Verdict {
        if self.source != Some(source) {
            self.segments += u64::from(self.leaves(source));
            self.source = Some(source);
            (self.last, self.newest) = (None, None);
            self.fit.restart();
        }
        let place = self.place(source, stamp_ns, arrival_ns);
        if self.newest.is_some_and(|newest| (0..LATE_NS).contains(&newest.saturating_sub(place))) {
            return Verdict::Late;
        }
        // Data comes when its last shot is measured.
        let observed = self.fit.observe(place.saturating_add(length_ns).cast_unsigned(), arrival_ns);
        if observed.step.is_some() {
            self.segments += 1;
            (self.last, self.newest) = (Some((stamp_ns, place, arrival_ns)), Some(place));
            return Verdict::NewSegment;
        }
        if observed.stamp_ns.is_none() {
            return Verdict::Unsure;
        }
        (self.last, self.newest) = (Some((stamp_ns, place, arrival_ns)), Some(place));
        Verdict::Accept(place)
    }

    /// The host's monotonic time of a place on the device's line.
    pub(crate) fn host_ns(&self, place: i64) -> Option<i64> {
        self.fit.host_ns(place.cast_unsigned())
    }

    /// The host's monotonic time of a stamp that was not judged, of data that came at `arrival_ns`; `None` where it is not known,
    /// and for a stamp that cannot be of this segment: measured after it came, or long before.
    pub(crate) fn host_ns_of(&self, source: TimeSource, stamp_ns: i64, arrival_ns: i64) -> Option<i64> {
        if self.source != Some(source) {
            return None;
        }
        let host_ns = self.host_ns(self.place(source, stamp_ns, arrival_ns))?;
        let way_ns = arrival_ns.saturating_sub(host_ns);
        (-FIT_NS..LONGEST_WAY_NS).contains(&way_ns).then_some(host_ns)
    }

    /// Puts the seconds back that a clock of pulses does not count.
    fn place(&self, source: TimeSource, stamp_ns: i64, arrival_ns: i64) -> i64 {
        let (TimeSource::Pulse, Some((last, place, last_arrival_ns))) = (source, self.last) else {
            return stamp_ns;
        };
        let ahead = (stamp_ns - last).rem_euclid(PULSE_NS);
        let elapsed = arrival_ns.saturating_sub(last_arrival_ns);
        let pulses = (elapsed - ahead + PULSE_NS / 2).div_euclid(PULSE_NS);
        place.saturating_add(ahead).saturating_add(pulses.saturating_mul(PULSE_NS))
    }
}

fn settings() -> Settings {
    Settings::counter(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Packets of 1 ms from `from_ms` on that come as soon as they are measured, the host's clock being `ahead_ms` ahead.
    fn run(
        timeline: &mut Timeline,
        source: TimeSource,
        stamps_ms: impl Iterator<Item = i64>,
        ahead_ms: i64,
    ) -> Vec<Verdict> {
        stamps_ms
            .map(|ms| {
                let stamp =
                    if source == TimeSource::Pulse { (ms * MS).rem_euclid(PULSE_NS) } else { ms * MS };
                timeline.judge(source, stamp, MS, (ms + 1 + ahead_ms) * MS)
            })
            .collect()
    }

    #[test]
    fn packets_are_accepted_once_the_clock_is_known_and_duplicates_are_late() {
        let mut timeline = Timeline::new();
        let verdicts = run(&mut timeline, TimeSource::PowerOn, 0..2000, 70_000);
        let unsure = verdicts.iter().take_while(|verdict| **verdict == Verdict::Unsure).count();
        assert!((400..600).contains(&unsure), "{unsure}");
        assert!(
            verdicts[unsure..]
                .iter()
                .enumerate()
                .all(|(i, v)| *v == Verdict::Accept((unsure + i) as i64 * MS))
        );
        assert_eq!(timeline.host_ns(1999 * MS), Some(71_999 * MS));
        let again = run(&mut timeline, TimeSource::PowerOn, 1995..2000, 70_002);
        assert_eq!(again, [Verdict::Late; 5]);
        assert_eq!(timeline.segments, 0);
    }

    #[test]
    fn a_clock_that_is_set_begins_a_new_segment_and_one_damaged_stamp_does_not() {
        let mut timeline = Timeline::new();
        run(&mut timeline, TimeSource::PowerOn, 0..2000, 0);
        assert_eq!(timeline.judge(TimeSource::PowerOn, 900_000 * MS, MS, 2001 * MS), Verdict::Unsure);
        assert_eq!(timeline.judge(TimeSource::PowerOn, 2001 * MS, MS, 2002 * MS), Verdict::Accept(2001 * MS));
        let verdicts = run(&mut timeline, TimeSource::PowerOn, 7000..9000, -4998);
        assert_eq!(verdicts.iter().filter(|verdict| **verdict == Verdict::NewSegment).count(), 1);
        assert!(matches!(verdicts.last(), Some(Verdict::Accept(_))));
        assert_eq!((timeline.segments, timeline.host_ns(8999 * MS)), (1, Some(4001 * MS)));
    }

    #[test]
    fn another_source_of_time_begins_a_new_segment() {
        let mut timeline = Timeline::new();
        run(&mut timeline, TimeSource::PowerOn, 0..1000, 0);
        let verdicts = run(
            &mut timeline,
            TimeSource::Ptp,
            1_700_000_000_000..1_700_000_002_000,
            1000 - 1_700_000_000_000,
        );
        assert!(matches!(verdicts.last(), Some(Verdict::Accept(_))));
        assert_eq!(timeline.segments, 1);
        assert!(timeline.leaves(TimeSource::Gps) && !timeline.leaves(TimeSource::Ptp));
    }

    #[test]
    fn a_clock_that_restarts_with_every_pulse_goes_on() {
        let mut timeline = Timeline::new();
        let verdicts = run(&mut timeline, TimeSource::Pulse, 300..4300, 0);
        assert!(verdicts[600..].iter().all(|verdict| matches!(verdict, Verdict::Accept(_))));
        assert_eq!(timeline.segments, 0);
        // A silence of three pulses.
        let verdicts = run(&mut timeline, TimeSource::Pulse, 7400..7500, 0);
        assert_eq!(verdicts[0], Verdict::Accept(7400 * MS));
        // What lies between packets is on the same line, also just behind the newest.
        let between = |ms: i64| timeline.host_ns_of(TimeSource::Pulse, ms % 1000 * MS, 7501 * MS);
        assert_eq!([7498, 7499, 7500].map(between), [7498, 7499, 7500].map(|ms| Some(ms * MS)));
    }

    #[test]
    fn a_stamp_of_another_clock_or_far_from_its_arrival_has_no_time() {
        let mut timeline = Timeline::new();
        assert_eq!(timeline.host_ns_of(TimeSource::PowerOn, 0, 0), None);
        run(&mut timeline, TimeSource::PowerOn, 0..2000, 70_000);
        let host_ns =
            |source, ms: i64, came_ms: i64| timeline.host_ns_of(source, ms * MS, (70_000 + came_ms) * MS);
        assert_eq!(host_ns(TimeSource::PowerOn, 1995, 1999), Some(71_995 * MS));
        for (source, ms) in [
            (TimeSource::Ptp, 1995),
            (TimeSource::PowerOn, 2010),
            (TimeSource::PowerOn, 900),
            (TimeSource::PowerOn, i64::MAX / MS),
        ] {
            assert_eq!(host_ns(source, ms, 1999), None, "{source:?} {ms}");
        }
    }
}
