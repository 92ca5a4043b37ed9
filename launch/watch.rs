//! Whether a stage hangs: its input goes on and its output does not.

use std::time::{Duration, Instant};

use evac_config::Mode;
use evac_frames::{Health, StageState};
use evac_ports::now_ns;
use evac_ports::services::{FrameService as _, MapSnapshot, OdometryPose, RecordService as _, ScanDeskewed};

use crate::error::LaunchError;
use crate::pulse::{Line, line_of};
use crate::registry::kind;
use crate::slot::Slot;

/// Lossless stages wait for each other, so that nobody's input goes on while one hangs: there a stage hangs that had work and did
/// nothing for so long. Half of what the source waits for its sinks.
const LOSSLESS_PATIENCE: Duration = Duration::from_secs(30);
/// Frames that come at once, from a stage that was started again, are no sign that their reader hangs: it has so long for the first.
const BURST: Duration = Duration::from_secs(1);
/// A stage that says that it waits, for the map's snapshot or what its start takes, has so long instead.
const WAITING_PATIENCE: Duration = Duration::from_secs(30);
/// Stages report each second. What one said that has been silent for so long says nothing about now: it may be stopped.
const OLDEST_REPORT_NS: i64 = 3_000_000_000;

/// What is known of the stages.
pub(crate) struct Seen<'a> {
    /// The newest frame of an instance.
    pub(crate) newest: &'a dyn Fn(&Line, u32) -> Option<u64>,
    /// Whether the leading instance says that it waits.
    pub(crate) waits: &'a dyn Fn(&Slot) -> bool,
}

/// Whether an instance whose newest report this is waits, by its own word, and lives.
pub(crate) fn says_that_it_waits(health: &Health) -> bool {
    health.state == StageState::Waiting as u32 && now_ns() - health.reported_ns < OLDEST_REPORT_NS
}

/// How a stage's frames compare with those of its inputs.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    /// By slot.
    stages: Vec<Option<Stand>>,
}

#[derive(Debug, Clone, Copy)]
struct Stand {
    epoch: u32,
    own: Option<u64>,
    /// Newest input when it put out `own`, and when there was a newer one.
    base: u64,
    behind: Option<Instant>,
    input: u64,
    /// Nothing was put out or came in since.
    since: Instant,
}

impl Watch {
    /// The leading instances that hang at the time `now`, with the reason; to be asked after everything was taken in that is `seen`.
    pub(crate) fn hung(
        &mut self,
        slots: &[Slot],
        seen: &Seen<'_>,
        (mode, after_frames): (Mode, u64),
        now: Instant,
    ) -> Result<Vec<(usize, String)>, LaunchError> {
        self.stages.resize(slots.len(), None);
        let mut hung = Vec::new();
        for (index, slot) in slots.iter().enumerate() {
            let Some(line) = line_of(slot).filter(|_| after_frames > 0) else { continue };
            let Some(input) = newest_input(slot, slots, seen)? else { continue };
            let own = (seen.newest)(&line, slot.epoch);
            let fresh = Stand { epoch: slot.epoch, own, base: input, behind: None, input, since: now };
            let Some(stand) = self.stages.get_mut(index) else { continue };
            let stand = stand.get_or_insert(fresh);
            if stand.epoch != slot.epoch || stand.own != own {
                *stand = fresh;
            } else if stand.input != input {
                (stand.input, stand.since) = (input, now);
                stand.behind = stand.behind.or(Some(now));
            }
            let missed = input.saturating_sub(stand.base);
            let last =
                own.map_or("it has put out nothing yet".to_owned(), |seq| format!("its last frame is {seq}"));
            let name = slot.name();
            let waits = (seen.waits)(slot);
            let patience = if waits { WAITING_PATIENCE } else { BURST };
            if missed >= after_frames && stand.behind.is_some_and(|since| now - since >= patience) {
                let waits = if waits { ", and still waits" } else { "" };
                let text = format!(
                    "stage '{name}' hangs: {missed} more frames came to it and it put out none{waits}; {last}"
                );
                hung.push((index, text));
            } else if mode == Mode::Lossless
                && own.is_none_or(|own| own < input)
                && now - stand.since > LOSSLESS_PATIENCE
            {
                let seconds = LOSSLESS_PATIENCE.as_secs();
                let text = format!(
                    "stage '{name}' hangs: frames wait for it, and it put out none for {seconds} s; {last}"
                );
                hung.push((index, text));
            }
        }
        Ok(hung)
    }

    /// What an instance did before it was killed is no business of the next one's.
    pub(crate) fn forget(&mut self, slot: usize) {
        if let Some(stand) = self.stages.get_mut(slot) {
            *stand = None;
        }
    }
}

/// The newest frame that all inputs of a stage have; `None` while one has none, or where it has no input.
fn newest_input(slot: &Slot, slots: &[Slot], seen: &Seen<'_>) -> Result<Option<u64>, LaunchError> {
    let mut newest: Option<u64> = None;
    for service in kind(&slot.entry.kind)?.reads {
        // Of what follows from a stage's own output it may not be waited for: a deskewer's prior. A snapshot comes when asked for.
        let is_prior =
            *service == OdometryPose::NAME && kind(&slot.entry.kind)?.writes.contains(&ScanDeskewed::NAME);
        if is_prior || *service == MapSnapshot::NAME {
            continue;
        }
        let writer = slots.iter().find(|writer| line_of(writer) == Some(Line::Service(service)));
        let Some(writer) = writer else { continue };
        let Some(seq) = (seen.newest)(&Line::Service(service), writer.epoch) else { return Ok(None) };
        newest = Some(newest.map_or(seq, |newest| newest.min(seq)));
    }
    Ok(newest)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use evac_config::StageEntry;

    use super::*;

    /// When the exporter is said to hang, in tenths of a second, where its input goes on ten times a second and it puts
    /// out nothing after frame `last`.
    fn hangs_after(last: Option<u64>, waits: impl Fn(u64) -> bool, most: u64) -> Option<(u64, String)> {
        let kinds = ["octree_mapper", "grid_exporter"];
        let slots: Vec<_> = kinds.map(|kind| Slot::new(&StageEntry::of_kind(kind)).unwrap()).into();
        let start = Instant::now();
        let mut watch = Watch::default();
        (0..most).find_map(|tenth| {
            let newest = |line: &Line, _| if matches!(line, Line::Sink(_)) { last } else { Some(10 + tenth) };
            let seen = Seen { newest: &newest, waits: &|_| waits(tenth) };
            let now = start + Duration::from_millis(100 * tenth);
            let hung = watch.hung(&slots, &seen, (Mode::Live, 20), now).unwrap();
            hung.into_iter().next().map(|(slot, reason)| {
                assert_eq!(slot, 1);
                (tenth, reason)
            })
        })
    }

    #[test]
    fn a_stage_that_says_that_it_waits_is_no_hung_one_until_it_has_waited_for_half_a_minute() {
        for last in [None, Some(9)] {
            let (tenth, _) = hangs_after(last, |_| false, 1000).unwrap();
            assert_eq!(tenth, 20, "twenty frames");
            let (tenth, reason) = hangs_after(last, |_| true, 1000).unwrap();
            assert_eq!(tenth, 301, "a time of its own");
            assert!(reason.contains("still waits"), "{reason}");
            // One that stops reporting while it waits, at 5 s.
            let (tenth, _) = hangs_after(last, |tenth| tenth < 50, 1000).unwrap();
            assert_eq!(tenth, 50);
        }
    }

    #[test]
    fn the_word_of_one_that_does_not_report_any_more_counts_for_nothing() {
        let health = |state: StageState, age_ns: i64| Health {
            state: state as u32,
            reported_ns: now_ns() - age_ns,
            ..Health::default()
        };
        assert!(says_that_it_waits(&health(StageState::Waiting, 1_000_000_000)));
        assert!(!says_that_it_waits(&health(StageState::Waiting, OLDEST_REPORT_NS)));
        assert!(!says_that_it_waits(&health(StageState::Running, 0)));
    }
}
