//! Which time stamps of a packet stream to believe. Packets carry neither a number nor a checksum.

/// A stamp further from the last one than this is believed only when the next packet goes on from there.
const JUMP: i64 = 20_000_000;
/// A longer gap is another recording, not lost packets.
const MAX_GAP: i64 = 10_000_000_000;

/// What to do with a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Goes on from the last.
    Accept,
    /// A duplicate, or overtaken on its way.
    Late,
    /// Far from both its neighbours: damaged, or the first after a gap.
    Stray,
    /// The device's clock was set, or it was started again.
    Step {
        /// The last stamp before, nanoseconds.
        from: i64,
    },
}

/// Follows the stamps of one stream.
#[derive(Debug, Clone, Default)]
pub(super) struct Clock {
    last: Option<i64>,
    stray: Option<i64>,
}

impl Clock {
    pub(super) fn judge(&mut self, stamp: i64) -> Verdict {
        let Some(last) = self.last else {
            self.last = Some(stamp);
            return Verdict::Accept;
        };
        let ahead = stamp.saturating_sub(last);
        if (1..=JUMP).contains(&ahead) {
            return self.accept(stamp);
        }
        if (-JUMP..=0).contains(&ahead) {
            return Verdict::Late;
        }
        let goes_on = self.stray.is_some_and(|stray| (1..=JUMP).contains(&stamp.saturating_sub(stray)));
        match goes_on {
            false => {
                self.stray = Some(stamp);
                Verdict::Stray
            }
            true if (1..=MAX_GAP).contains(&ahead) => self.accept(stamp),
            true => Verdict::Step { from: last },
        }
    }

    fn accept(&mut self, stamp: i64) -> Verdict {
        self.last = Some(stamp);
        self.stray = None;
        Verdict::Accept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn verdicts(milliseconds: &[i64]) -> Vec<Verdict> {
        let mut clock = Clock::default();
        milliseconds.iter().map(|stamp| clock.judge(stamp * MS)).collect()
    }

    #[test]
    fn one_damaged_stamp_costs_one_packet() {
        use Verdict::{Accept, Late, Stray};
        assert_eq!(
            verdicts(&[0, 1, 900_000, 3, 3, 2, 4]),
            [Accept, Accept, Stray, Accept, Late, Late, Accept]
        );
        assert_eq!(verdicts(&[50_000, 50_001, 7, 50_003]), [Accept, Accept, Stray, Accept]);
    }

    #[test]
    fn packets_go_on_after_a_gap_of_seconds_but_not_after_a_step_of_the_clock() {
        use Verdict::{Accept, Step, Stray};
        assert_eq!(verdicts(&[0, 1, 4000, 4001, 4002]), [Accept, Accept, Stray, Accept, Accept]);
        assert_eq!(verdicts(&[900, 901, 1, 2]), [Accept, Accept, Stray, Step { from: 901 * MS }]);
        assert_eq!(verdicts(&[0, 20_000, 20_001]), [Accept, Stray, Step { from: 0 }]);
    }
}
