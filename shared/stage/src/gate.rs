//! Out of the frames of several instances of one stage, each exactly once and in order: what a reader's side of a hot swap is.
//!
//! Every frame carries its writer's `epoch` and the gap-free `seq` of its scan; the launcher's [`Route`] says from which
//! `seq` on which epoch is listened to. A gate hands on the next frame that is wanted from the instance it is wanted of,
//! holds what is early, and leaves out the other's copies. What one instance sends comes in order, so a gap in it is a
//! loss, and nothing that can still come is taken for lost. Without a route there is one instance, and frames pass
//! straight through.

use std::collections::VecDeque;

use evac_frames::{Health, Route, route_flags};

use crate::InputCounters;

/// Early frames that a gate holds; with one more it stops waiting.
pub(crate) const MAX_EARLY: usize = 20;
/// Cuts that a reader may be behind.
const MAX_CUTS: usize = 8;

/// See the module's text.
#[derive(Debug)]
pub(crate) struct Gate<T> {
    service: &'static str,
    /// The next frame wanted; `None` before the first, as a stage may join late.
    next: Option<u64>,
    /// Writer of the newest frame that was handed on.
    epoch: u32,
    /// In the order of their frames; before the first anything older is listened to.
    cuts: VecDeque<Cut>,
    generation: u64,
    /// Newest frame that has come from an epoch older than the first cut's.
    before: Option<u64>,
    early: VecDeque<(u64, u32, T)>,
    /// The routed instance has given way to an older one, and so have all up to this epoch: what they sent is no use.
    void: u32,
}

/// From `from_seq` on `epoch` is listened to.
#[derive(Debug, Clone, Copy)]
struct Cut {
    from_seq: u64,
    epoch: u32,
    /// No older instance lives. One that died without a word may have got as far as it did beyond the cut.
    alone: bool,
    /// Newest frame that has come from it.
    newest: Option<u64>,
}

impl<T> Gate<T> {
    pub(crate) fn new(service: &'static str) -> Self {
        Self {
            service,
            next: None,
            epoch: 0,
            cuts: VecDeque::with_capacity(MAX_CUTS + 1),
            generation: 0,
            before: None,
            early: VecDeque::with_capacity(MAX_EARLY + 1),
            void: 0,
        }
    }

    /// Takes the launcher's word. To be called before the frames are taken that came with it: when a word says that an instance
    /// has ended, all that it sent is there.
    pub(crate) fn route(&mut self, route: &Route) {
        let asks = route.flags & route_flags::HAND_OVER != 0;
        if asks || route.generation <= self.generation || Health::text_of(&route.service) != self.service {
            return;
        }
        self.generation = route.generation;
        let alone = route.flags & route_flags::ALONE != 0;
        // The same cut again says that the old instance has ended; a cut that none got to is void.
        let known = self.cuts.iter().find(|cut| cut.epoch == route.epoch).and_then(|cut| cut.newest);
        let youngest = self.cuts.iter().map(|cut| cut.epoch).max().unwrap_or(0);
        self.void = if youngest > route.epoch { youngest } else { self.void };
        self.early.retain(|(_, epoch, _)| *epoch <= route.epoch || *epoch > self.void);
        while self.cuts.back().is_some_and(|cut| cut.from_seq >= route.from_seq || cut.epoch == route.epoch) {
            self.cuts.pop_back();
        }
        let newest =
            self.early.iter().filter(|(_, epoch, _)| *epoch == route.epoch).map(|(seq, ..)| *seq).max();
        let cut = Cut { from_seq: route.from_seq, epoch: route.epoch, alone, newest: newest.max(known) };
        self.cuts.push_back(cut);
        if self.cuts.len() > MAX_CUTS {
            self.cuts.pop_front();
        }
    }

    /// Takes a frame; gives the one that can be handed on now, if there is one.
    pub(crate) fn offer(&mut self, seq: u64, epoch: u32, frame: T, input: &mut InputCounters) -> Option<T> {
        let leads = self.cuts.back().map_or(self.epoch, |cut| cut.epoch);
        if epoch > leads && epoch <= self.void {
            return None;
        }
        // The instance of the start is the oldest; of another one it is not known whether it is routed.
        let known = if self.next.is_some() { epoch <= self.epoch } else { epoch == 0 };
        if self.cuts.is_empty() && self.early.is_empty() && known {
            return self.pass(seq, epoch, frame, input);
        }
        self.note(seq, epoch);
        // The route of a new instance may come after its first frames.
        let routed = self.cuts.back().is_some_and(|cut| epoch <= cut.epoch);
        if routed && self.next.is_some_and(|next| seq < next) {
            // A copy of another instance is no straggler.
            input.late += u64::from(epoch == self.epoch);
            return None;
        }
        // A frame beyond its instance's end says that the instance leads again; that word is under way.
        let goes_on =
            self.cut_of(seq).and_then(|index| self.cuts.get(index)).is_some_and(|cut| epoch < cut.epoch);
        if routed && !goes_on && !self.is_listened_to(seq, epoch) {
            return None;
        }
        if routed && self.next == Some(seq) && self.is_listened_to(seq, epoch) {
            return self.hand_on(seq, epoch, frame);
        }
        self.early.push_back((seq, epoch, frame));
        if self.early.len() > MAX_EARLY { self.give_up(input) } else { None }
    }

    /// A frame that was early and is wanted now; to be asked after everything that has come was offered.
    pub(crate) fn pop(&mut self, input: &mut InputCounters) -> Option<T> {
        if self.early.is_empty() {
            return None;
        }
        if self.cuts.is_empty() {
            // The first of all: the oldest instance's, as the newest may not be routed yet.
            let started = self.next.is_some();
            let known =
                self.early.iter().enumerate().filter(|(_, (_, epoch, _))| !started || *epoch <= self.epoch);
            let first = known.min_by_key(|(_, (seq, epoch, _))| (*epoch, *seq)).map(|(index, _)| index)?;
            let (seq, epoch, frame) = self.early.remove(first)?;
            return self.pass(seq, epoch, frame, input);
        }
        while let Some(index) = self.earliest() {
            let (seq, epoch) = self.early.get(index).map(|(seq, epoch, _)| (*seq, *epoch))?;
            let want = self.next.unwrap_or(seq);
            if seq > want && self.may_come(want) {
                return None;
            }
            let (_, _, frame) = self.early.remove(index)?;
            if seq >= want {
                input.lost += seq - want;
                return self.hand_on(seq, epoch, frame);
            }
        }
        None
    }

    /// One instance: nothing is waited for.
    fn pass(&mut self, seq: u64, epoch: u32, frame: T, input: &mut InputCounters) -> Option<T> {
        let want = self.next.unwrap_or(seq);
        if seq < want || epoch < self.epoch {
            input.late += u64::from(epoch == self.epoch);
            return None;
        }
        input.lost += seq - want;
        self.hand_on(seq, epoch, frame)
    }

    fn hand_on(&mut self, seq: u64, epoch: u32, frame: T) -> Option<T> {
        (self.next, self.epoch) = (Some(seq.saturating_add(1)), epoch);
        let leads = self.cuts.back().map_or(0, |cut| cut.epoch);
        self.early.retain(|(early, of, _)| *early > seq || *of > leads);
        while self.cuts.get(1).is_some_and(|second| second.from_seq <= seq) {
            self.cuts.pop_front();
        }
        Some(frame)
    }

    fn note(&mut self, seq: u64, epoch: u32) {
        if self.cuts.front().is_some_and(|first| epoch < first.epoch) {
            self.before = self.before.max(Some(seq));
        } else if let Some(cut) = self.cuts.iter_mut().find(|cut| cut.epoch == epoch) {
            cut.newest = cut.newest.max(Some(seq));
        }
    }

    /// Number of the last cut at or before `seq`.
    fn cut_of(&self, seq: u64) -> Option<usize> {
        self.cuts.iter().rposition(|cut| cut.from_seq <= seq)
    }

    fn is_listened_to(&self, seq: u64, epoch: u32) -> bool {
        match self.cut_of(seq).and_then(|index| self.cuts.get(index)) {
            // An instance that was killed may be ahead of what the launcher knew; either copy will do.
            Some(cut) => epoch == cut.epoch || cut.alone && epoch < cut.epoch,
            // Of what an ended instance left out before the cut, the new one may have a copy.
            None => self
                .cuts
                .front()
                .is_some_and(|first| epoch < first.epoch || first.alone && epoch == first.epoch),
        }
    }

    /// Whether somebody who is listened to may still send `want`.
    fn may_come(&self, want: u64) -> bool {
        let passed = |newest: Option<u64>| newest.is_some_and(|newest| newest > want);
        let ended = |index: usize| self.cuts.range(index..).any(|cut| cut.alone);
        match self.cut_of(want) {
            None => !passed(self.before) && !ended(0),
            Some(index) => self.cuts.get(index).is_some_and(|cut| !passed(cut.newest)) && !ended(index + 1),
        }
    }

    /// Index of the early frame with the smallest number of those that are listened to.
    fn earliest(&self) -> Option<usize> {
        let of_known = self.early.iter().enumerate().filter(|(_, (seq, epoch, _))| {
            self.cuts.back().is_some_and(|cut| *epoch <= cut.epoch) && self.is_listened_to(*seq, *epoch)
        });
        of_known.min_by_key(|(_, (seq, epoch, _))| (*seq, *epoch)).map(|(index, _)| index)
    }

    /// Too much is held: what is waited for will not come, or the route of a new instance will not.
    fn give_up(&mut self, input: &mut InputCounters) -> Option<T> {
        let mut epochs = self.early.iter().map(|(_, epoch, _)| *epoch);
        if self.cuts.is_empty() && (self.next.is_none() || epochs.any(|epoch| epoch <= self.epoch)) {
            return self.pop(input);
        }
        let newest = self.early.iter().map(|(_, epoch, _)| *epoch).max()?;
        if self.cuts.back().is_none_or(|cut| newest > cut.epoch) {
            // An instance that nobody routed: it is a stage that was started anew, and counts from where it will.
            let from_seq =
                self.early.iter().filter(|(_, epoch, _)| *epoch == newest).map(|(seq, ..)| *seq).min()?;
            self.cuts.clear();
            self.early.retain(|(_, epoch, _)| *epoch == newest);
            self.cuts.push_back(Cut { from_seq, epoch: newest, alone: true, newest: Some(u64::MAX) });
            self.next = None;
        }
        let index = self.earliest()?;
        let (seq, epoch, frame) = self.early.remove(index)?;
        input.lost += seq - self.next.unwrap_or(seq).min(seq);
        self.hand_on(seq, epoch, frame)
    }
}

#[cfg(test)]
mod tests;
