//! One service as the recorder listens to it.

use std::collections::VecDeque;

use evac_frames::{FrameHeader, Route, frame_flags};
use evac_ports::services::{FrameService, RecordService};
use evac_ports::{FrameSample, FrameSubscriber, PortError, RecordSubscriber};

use super::seq::SeqTracker;
use crate::gate::Gate;
use crate::{InputCounters, Reporter};

/// A port that messages come from, frames or records.
pub(super) trait Receive {
    type Message;
    fn receive(&self) -> Result<Option<Self::Message>, PortError>;
    fn has_publisher(&self) -> bool;
}

impl<S: FrameService> Receive for FrameSubscriber<S> {
    type Message = FrameSample<S>;

    fn receive(&self) -> Result<Option<Self::Message>, PortError> {
        self.receive()
    }

    fn has_publisher(&self) -> bool {
        self.has_publisher()
    }
}

impl<S: RecordService> Receive for RecordSubscriber<S> {
    type Message = S::Record;

    fn receive(&self) -> Result<Option<Self::Message>, PortError> {
        self.receive()
    }

    fn has_publisher(&self) -> bool {
        self.has_publisher()
    }
}

/// What has come of a service and is not handed on yet.
pub(super) struct Tap<P: Receive> {
    port: P,
    /// Where the writer may be swapped: lets through what every other reader takes.
    gate: Option<Gate<P::Message>>,
    pub(super) queue: VecDeque<P::Message>,
    /// Messages taken in at once; the rest stays in shared memory.
    most: usize,
    pub(super) seq: SeqTracker,
    ended: bool,
}

/// How far a service that a stage writes has come.
#[derive(Debug, Clone, Copy)]
pub(super) struct Progress {
    /// The first frame that has not come.
    pub(super) next: u64,
    pub(super) ended: bool,
}

impl<P: Receive> Tap<P> {
    pub(super) fn new(port: P, most: usize) -> Self {
        let queue = VecDeque::with_capacity(most);
        Self { port, gate: None, queue, most, seq: SeqTracker::default(), ended: false }
    }

    /// For a service whose writer may be swapped.
    pub(super) fn gated(self, service: &'static str) -> Self {
        Self { gate: Some(Gate::new(service)), ..self }
    }

    pub(super) fn route(&mut self, route: &Route) {
        if let Some(gate) = &mut self.gate {
            gate.route(route);
        }
    }

    pub(super) fn take_in(
        &mut self,
        reporter: &mut Reporter,
        frame: impl Fn(&P::Message) -> FrameHeader,
    ) -> Result<(), PortError> {
        while self.queue.len() < self.most {
            let Some(message) = self.port.receive()? else {
                let early = self.gate.as_mut().and_then(|gate| gate.pop(&mut reporter.input));
                let Some(early) = early else { break };
                self.queue.push_back(early);
                continue;
            };
            let FrameHeader { seq, epoch, sent_ns, .. } = frame(&message);
            reporter.received(sent_ns);
            self.queue.extend(match &mut self.gate {
                None => Some(message),
                Some(gate) => gate.offer(seq, epoch, message, &mut reporter.input),
            });
        }
        Ok(())
    }

    /// Counts what is missing before a message that is handed on, where no gate has.
    pub(super) fn pass(
        &mut self,
        frame: &FrameHeader,
        lost: impl FnOnce(&mut InputCounters) -> &mut u64,
        reporter: &mut Reporter,
    ) -> FrameHeader {
        let gap = self.seq.gap(frame.seq).unwrap_or_default();
        if self.gate.is_none() {
            *lost(&mut reporter.input) += gap;
        }
        self.ended |= frame.flags & frame_flags::END_OF_STREAM != 0;
        *frame
    }

    /// Nothing where no stage writes the service.
    pub(super) fn progress(&self) -> Option<Progress> {
        let next = self.seq.passed();
        let is_written = next.is_some() || self.port.has_publisher();
        is_written.then(|| Progress { next: next.unwrap_or_default(), ended: self.ended })
    }
}
