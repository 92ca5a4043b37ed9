//! What an instance does with its frames: it leads, follows the one that does, goes beside it, or has handed over.

use evac_frames::{Health, Route, route_flags};

use crate::follow::Follower;

/// See the module's text.
#[derive(Debug)]
pub(crate) enum Role<F> {
    /// Processes and publishes.
    Lead,
    /// Processes as if it led, and publishes where nobody in the pipeline listens.
    Shadow,
    /// Keeps up with the instance that leads.
    Follow(Box<Standby<F>>),
    /// Does nothing but hold its inputs, in case the other one fails.
    Retired,
}

/// A standby.
#[derive(Debug)]
pub(crate) struct Standby<F> {
    pub(crate) follower: F,
    /// It takes over as soon as everything is followed that the routed instance has put out.
    pub(crate) promotion: Option<Promotion>,
    /// As soon as it could take over it goes on by itself instead.
    pub(crate) shadow: bool,
    /// The last frame of the stream was followed.
    pub(crate) ended: bool,
    /// A sink's: it has what the routed instance had gathered before it came.
    pub(crate) restored: bool,
}

/// The launcher's word that an instance takes over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Promotion {
    /// The first frame of the new one, if the old one has said so.
    pub(crate) from_seq: u64,
    /// The old one has died.
    pub(crate) alone: bool,
}

/// What a route asks of this instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    Lead(Promotion),
    Retire,
}

/// Which words of the launcher are about this instance.
#[derive(Debug)]
pub(crate) struct Orders {
    stage: [u8; 32],
    epoch: u32,
    generation: u64,
}

impl Orders {
    pub(crate) fn new(stage: &str, epoch: u32) -> Self {
        Self { stage: Health::text(stage), epoch, generation: 0 }
    }

    /// What the route asks of this instance, where it is about its stage and news.
    pub(crate) fn of(&mut self, route: &Route) -> Option<Order> {
        if route.stage != self.stage || route.generation <= self.generation {
            return None;
        }
        self.generation = route.generation;
        let asks = route.flags & route_flags::HAND_OVER != 0;
        let alone = route.flags & route_flags::ALONE != 0;
        match (route.epoch == self.epoch, asks) {
            (true, true) => Some(Order::Retire),
            (true, false) => Some(Order::Lead(Promotion { from_seq: route.from_seq, alone })),
            // Another leads: this one was given up, and lives on by mistake.
            (false, false) if route.epoch > self.epoch => Some(Order::Retire),
            _ => None,
        }
    }
}

impl<F: Follower> Role<F> {
    pub(crate) fn leads(&self) -> bool {
        matches!(self, Self::Lead)
    }

    /// Whether it processes frames itself.
    pub(crate) fn processes(&self) -> bool {
        matches!(self, Self::Lead | Self::Shadow)
    }
}
