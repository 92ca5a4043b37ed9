//! Gaps in sequence numbers.

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
}
