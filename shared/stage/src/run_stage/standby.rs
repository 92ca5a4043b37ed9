//! Frames of an instance that follows the one that leads, and how it takes over.

use evac_frames::{FrameHeader, StageState, frame_flags};

use super::Running;
use crate::follow::{Followed as _, Follower as _};
use crate::joins::Join;
use crate::journal::Start;
use crate::role::{Promotion, Role};
use crate::{Readiness, RunError, Stage, StageError, StageOutput as _};

impl<S, J> Running<S, J>
where
    J: Join,
    S: for<'a> Stage<Input<'a> = J::Frame<'a>>,
{
    /// Follows the routed instance by one frame, or takes over from it when it was followed to its end.
    pub(super) fn follow_next(&mut self) -> Result<bool, RunError> {
        let Role::Follow(standby) = &mut self.role else { return Ok(false) };
        // After its first frame, so that the map's stream has begun by then. From one that has died nothing more can be had.
        let alone = standby.promotion.is_some_and(|promotion| promotion.alone);
        if let (Some(checkpoints), Some(last), false) =
            (&mut self.checkpoints, self.last_seq, standby.restored || alone)
        {
            match checkpoints.take() {
                Some((seq, mut state)) if seq >= last => {
                    self.stage.load_state(&mut state, seq)?;
                    standby.restored = true;
                }
                _ => {
                    checkpoints.ask()?;
                    self.reporter.change(StageState::Following)?;
                    self.join.limit(0);
                    return Ok(false);
                }
            }
        }
        let Some((seq, stands_alone)) = standby.follower.front() else {
            let promotion = standby.promotion;
            self.join.limit(0);
            return promotion.map_or(Ok(false), |promotion| self.take_over(promotion));
        };
        let stage = &mut self.stage;
        let mut readiness = None;
        let mut frame = None;
        if !stands_alone {
            self.join.limit(seq.saturating_add(1));
            let follower = &standby.follower;
            frame = self.join.next(&mut self.reporter, |input, frame, _| {
                let routed = follower.first().filter(|_| frame.seq == seq);
                readiness = Some(stage.follow(input, routed)?);
                Ok::<FrameHeader, StageError>(*frame)
            });
        }
        let handled = match frame.transpose()? {
            Some(frame) => {
                standby.ended |= frame.flags & frame_flags::END_OF_STREAM != 0;
                frame.seq
            }
            None if stands_alone || self.join.front().is_some_and(|front| front > seq) => {
                if let Some(routed) = standby.follower.first() {
                    stage.adopt(routed)?;
                }
                seq
            }
            None => return Ok(false),
        };
        if handled == seq {
            if let Some(routed) = standby.follower.first() {
                self.output.note(&routed);
            }
            standby.follower.pop();
        }
        // What was missed has to be asked for again.
        standby.restored &= self.last_seq.is_none_or(|last| handled <= last.saturating_add(1));
        self.last_seq = Some(handled);
        self.reporter.followed(handled);
        if standby.shadow && readiness == Some(Readiness::Ready) {
            return self.go_beside(handled);
        }
        match readiness {
            Some(Readiness::Following) => self.reporter.change(StageState::Following)?,
            Some(Readiness::Ready) => self.reporter.change(StageState::Ready)?,
            None => {}
        }
        Ok(true)
    }

    /// From the next frame on it goes by itself.
    fn go_beside(&mut self, last_seq: u64) -> Result<bool, RunError> {
        self.role = Role::Shadow;
        self.leads_from = last_seq.saturating_add(1);
        self.join.limit(u64::MAX);
        self.reporter.forget();
        self.reporter.change(StageState::Shadow)?;
        Ok(true)
    }

    fn take_over(&mut self, promotion: Promotion) -> Result<bool, RunError> {
        let Role::Follow(standby) = std::mem::replace(&mut self.role, Role::Lead) else { return Ok(false) };
        if promotion.alone && self.last_seq.is_none() {
            self.read_back()?;
        } else {
            self.open_journal(Start::Whole)?;
        }
        self.leads_from = self.last_seq.map_or(0, |seq| seq.saturating_add(1));
        if promotion.alone {
            // Who was killed may have handed its last output to some of its readers only.
            if let Some(routed) = standby.follower.last() {
                self.output.repeat(routed)?;
            }
            if let (Some(ack), Some(seq)) = (&self.ack, self.last_seq) {
                ack.send(seq, false)?;
            }
        } else {
            self.leads_from = self.leads_from.max(promotion.from_seq);
        }
        self.join.limit(u64::MAX);
        self.reporter.forget();
        self.reporter.odometry = self.output.odometry();
        self.reporter.change(StageState::Running)?;
        self.ended = standby.ended;
        if self.ended {
            self.end()?;
            if let (Some(ack), Some(seq)) = (&self.ack, self.last_seq) {
                ack.send(seq, true)?;
            }
        }
        Ok(true)
    }
}
