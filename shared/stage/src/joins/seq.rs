//! Gaps in sequence numbers.

use crate::InputCounters;

/// Follows the sequence numbers of one stream.
#[derive(Debug, Default)]
pub(crate) struct SeqTracker {
    next: Option<u64>,
}

impl SeqTracker {
    /// Numbers missing before `seq`, `None` for one that was passed before. What came before the first is not missed: a
    /// stage may join late.
    pub(crate) fn gap(&mut self, seq: u64) -> Option<u64> {
        let gap = seq.checked_sub(self.next.unwrap_or(seq))?;
        self.next = Some(seq.saturating_add(1));
        Some(gap)
    }

    /// The number after the last one; `None` before the first.
    pub(crate) fn passed(&self) -> Option<u64> {
        self.next
    }

    /// Counts the frames missing before `seq`, or the frame itself as late where its place has been passed; whether it
    /// is to be used.
    pub(crate) fn count(&mut self, seq: u64, input: &mut InputCounters) -> bool {
        let gap = self.gap(seq);
        match gap {
            Some(gap) => input.lost += gap,
            None => input.late += 1,
        }
        gap.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_joiner_has_lost_nothing_and_a_gap_counts_what_is_missing() {
        let mut tracker = SeqTracker::default();
        assert_eq!(tracker.gap(7), Some(0));
        assert_eq!(tracker.gap(8), Some(0));
        assert_eq!(tracker.gap(11), Some(2));
        assert_eq!(tracker.gap(9), None);
        assert_eq!(tracker.gap(12), Some(0));
    }

    #[test]
    fn a_frame_that_comes_twice_is_counted_as_late_and_not_used() {
        let (mut tracker, mut input) = (SeqTracker::default(), InputCounters::default());
        let used = [4, 4, 7].map(|seq| tracker.count(seq, &mut input));
        assert_eq!(used, [true, false, true]);
        assert_eq!((input.lost, input.late), (2, 1));
    }
}
