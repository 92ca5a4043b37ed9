//! A stage as the launcher knows it: which of its instances leads, and what was said about it.

use evac_config::StageEntry;
use evac_frames::{Health, NO_SEQ, Route, route_flags};

use crate::error::LaunchError;
use crate::registry::{Role, kind};

/// One stage of the pipeline.
#[derive(Debug)]
pub(crate) struct Slot {
    /// As the instance that leads was started.
    pub(crate) entry: StageEntry,
    pub(crate) role: Role,
    /// The instance that leads.
    pub(crate) epoch: u32,
    next_epoch: u32,
    generation: u64,
    /// Times that it was started again after a crash.
    pub(crate) restarts: u64,
    /// The newest word on who leads; nothing was said while it is the first instance.
    pub(crate) route: Option<Route>,
}

impl Slot {
    pub(crate) fn new(entry: &StageEntry) -> Result<Self, LaunchError> {
        let role = kind(&entry.kind)?.role;
        Ok(Self {
            entry: entry.clone(),
            role,
            epoch: 0,
            next_epoch: 1,
            generation: 0,
            restarts: 0,
            route: None,
        })
    }

    pub(crate) fn name(&self) -> &str {
        self.entry.name()
    }

    pub(crate) fn take_epoch(&mut self) -> u32 {
        let epoch = self.next_epoch;
        self.next_epoch += 1;
        epoch
    }

    /// Asks the leading instance to stop and to say where.
    pub(crate) fn ask_to_hand_over(&mut self) -> Result<Route, LaunchError> {
        let from_seq = self.route.map_or(0, |route| route.from_seq);
        self.word(self.epoch, from_seq, route_flags::HAND_OVER)
    }

    /// The leading instance goes on: the one that was to take over has failed.
    pub(crate) fn go_on(&mut self) -> Result<Route, LaunchError> {
        let (from_seq, flags) =
            self.route.map_or((0, route_flags::ALONE), |route| (route.from_seq, route.flags));
        let route = self.word(self.epoch, from_seq, flags)?;
        self.route = Some(route);
        Ok(route)
    }

    /// `epoch`, which had handed over, leads again: the one that took over has died. `before` is what was said when it led.
    pub(crate) fn go_back(&mut self, epoch: u32, before: Option<Route>) -> Result<Route, LaunchError> {
        (self.epoch, self.route) = (epoch, before);
        self.go_on()
    }

    /// `epoch` leads after `last_seq`, which an older instance that still lives has dealt with.
    pub(crate) fn hand_over(&mut self, epoch: u32, last_seq: u64) -> Result<Route, LaunchError> {
        let from_seq = if last_seq == NO_SEQ { 0 } else { last_seq.saturating_add(1) };
        self.lead(epoch, from_seq, 0)
    }

    /// The instance before the leading one has ended.
    pub(crate) fn alone(&mut self) -> Result<Route, LaunchError> {
        let from_seq = self.route.map_or(0, |route| route.from_seq);
        self.lead(self.epoch, from_seq, route_flags::ALONE)
    }

    /// `epoch` leads after an instance that has died without a word.
    pub(crate) fn take_over(&mut self, epoch: u32) -> Result<Route, LaunchError> {
        self.lead(epoch, 0, route_flags::ALONE)
    }

    fn lead(&mut self, epoch: u32, from_seq: u64, flags: u32) -> Result<Route, LaunchError> {
        self.epoch = epoch;
        let route = self.word(epoch, from_seq, flags)?;
        self.route = Some(route);
        Ok(route)
    }

    fn word(&mut self, epoch: u32, from_seq: u64, flags: u32) -> Result<Route, LaunchError> {
        self.generation += 1;
        let writes = kind(&self.entry.kind)?.writes;
        Ok(Route {
            stage: Health::text(self.entry.name()),
            service: Health::text(writes.first().copied().unwrap_or_default()),
            generation: self.generation,
            from_seq,
            epoch,
            flags,
        })
    }
}
