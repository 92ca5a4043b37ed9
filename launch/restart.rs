//! A stage that has crashed is started anew, as a standby of the instance that is no more: it follows what is remembered of that
//! one's output, and leads.
//!
//! Inputs that were under way come from the history that their writers keep, 16 frames of each. Of an odometry the launcher remembers
//! as many poses, so that a new one lays its map from these scans and goes on in the same map frame. Mapper and sinks go on from their
//! journals (`evac-stage`), producers with the next frame (`producer.rs`).

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use evac_frames::{PoseFrame, StageState};
use evac_ports::services::OdometryPose;
use evac_ports::{Bus, PortError, RecordPublisher, RecordSubscriber};

use crate::child::Child;
use crate::error::LaunchError;
use crate::recording;
use crate::registry::{ODOMETRIES, Role};
use crate::supervisor::Supervisor;

/// Crashes of one stage within `WINDOW` that are put up with, and how long is waited before each new start.
const BACK_OFF: [Duration; 3] = [Duration::ZERO, Duration::from_millis(500), Duration::from_secs(2)];
const WINDOW: Duration = Duration::from_secs(60);
/// How long a new instance may take until its ports are open.
const PATIENCE: Duration = Duration::from_secs(20);
/// Poses that are remembered: as many as scans are in the history.
const REMEMBERED: usize = 16;
/// What a process that panicked ends with.
const PANICKED: i32 = 101;

/// Restarts under way, and what they need.
#[derive(Debug)]
pub(crate) struct Restarts {
    under_way: Vec<Restart>,
    /// Stage and time of every crash.
    crashes: Vec<(usize, Instant)>,
    poses: RecordSubscriber<OdometryPose>,
    newest: VecDeque<PoseFrame>,
    /// Says the poses of a dead odometry again, of the slot named. It is there until that one's stage has resumed, as what it keeps
    /// for those who come later would be a gap to the next; and by its publishers a recorder knows which services a stage writes.
    again: Option<(usize, RecordPublisher<OdometryPose>)>,
}

#[derive(Debug, Clone, Copy)]
struct Restart {
    slot: usize,
    /// When it is to be started.
    due: Instant,
    /// The new instance, once it is.
    epoch: Option<u32>,
}

impl Restarts {
    pub(crate) fn open(bus: &Bus) -> Result<Self, PortError> {
        Ok(Self {
            under_way: Vec::new(),
            crashes: Vec::new(),
            poses: RecordSubscriber::open(bus)?.0,
            newest: VecDeque::with_capacity(REMEMBERED + 1),
            again: None,
        })
    }

    pub(crate) fn are_under_way(&self) -> bool {
        !self.under_way.is_empty()
    }

    /// Whether the instance is one that is being started.
    pub(crate) fn is_about(&self, slot: usize, epoch: u32) -> bool {
        self.under_way.iter().any(|restart| restart.slot == slot && restart.epoch == Some(epoch))
    }

    fn take_in(&mut self) -> Result<(), PortError> {
        while let Some(pose) = self.poses.receive()? {
            self.newest.push_back(pose);
            if self.newest.len() > REMEMBERED {
                self.newest.pop_front();
            }
        }
        Ok(())
    }

    /// How long to wait before the stage is started again; `None` when it has crashed too often.
    fn back_off(&mut self, slot: usize) -> Option<Duration> {
        self.crashes.retain(|(_, time)| time.elapsed() < WINDOW);
        let crashes = self.crashes.iter().filter(|(of, _)| *of == slot).count();
        self.crashes.push((slot, Instant::now()));
        BACK_OFF.get(crashes).copied()
    }
}

impl Supervisor {
    /// Plans the restart of a stage whose instance `child` has died; false where there will be none.
    pub(crate) fn plan_restart(&mut self, slot: usize, child: (&str, u32)) -> Result<bool, LaunchError> {
        let is_producer = self.slots.get(slot).is_none_or(|slot| slot.role == Role::Producer);
        let crashed = self.child(child.0, child.1).is_some_and(crashed);
        let Some(restarts) = self.restarts.as_mut().filter(|_| crashed) else { return Ok(false) };
        let Some(wait) = restarts.back_off(slot) else { return Ok(false) };
        if is_producer {
            self.replace_dead_producer(slot, wait);
            return Ok(true);
        }
        restarts.under_way.retain(|restart| restart.slot != slot);
        restarts.under_way.push(Restart { slot, due: Instant::now() + wait, epoch: None });
        Ok(true)
    }

    /// Carries the restarts on.
    pub(crate) fn restart(&mut self) -> Result<(), LaunchError> {
        let Some(restarts) = &mut self.restarts else { return Ok(()) };
        restarts.take_in()?;
        let is_open =
            |slot: &usize| self.slots.get(*slot).is_some_and(|slot| self.incidents.open(slot.name()));
        restarts.again.take_if(|(slot, _)| !is_open(slot));
        for restart in restarts.under_way.clone() {
            let done = self.carry_on(restart)?;
            let Some(restarts) = &mut self.restarts else { return Ok(()) };
            restarts.under_way.retain(|other| other.slot != restart.slot);
            restarts.under_way.extend(done);
        }
        Ok(())
    }

    /// The restart as it stands afterwards, `None` when it is through.
    fn carry_on(&mut self, mut restart: Restart) -> Result<Option<Restart>, LaunchError> {
        let Some(entry) = self.slots.get(restart.slot).map(|slot| slot.entry.clone()) else {
            return Ok(None);
        };
        let Some(epoch) = restart.epoch else {
            if Instant::now() >= restart.due {
                restart.epoch = Some(self.start_standby(restart.slot, &recording::beside(&entry))?.0);
            }
            return Ok(Some(restart));
        };
        let child = self.child(entry.name(), epoch);
        if child.is_none_or(|child| child.ended.is_some()) || restart.due.elapsed() > PATIENCE {
            let failure = child.map(Child::failure);
            return Err(failure.unwrap_or_else(|| {
                LaunchError::Silent(format!("stage '{}' could not be started again", entry.name()))
            }));
        }
        let states = [StageState::Following as u32, StageState::Ready as u32];
        if !self.board.of(entry.name(), epoch).is_some_and(|health| states.contains(&health.state)) {
            return Ok(Some(restart));
        }
        if ODOMETRIES.contains(&entry.kind.as_str())
            && let Some(Restarts { newest, again, .. }) = &mut self.restarts
        {
            // A new one each time, without what the one before has said.
            let (_, again) = again.insert((restart.slot, RecordPublisher::open(&self.bus)?));
            for pose in newest.iter() {
                again.publish(pose)?;
            }
        }
        self.lead(restart.slot, &entry, |slot| slot.take_over(epoch))?;
        tracing::warn!(stage = entry.name(), epoch, "started again");
        Ok(None)
    }
}

/// Whether it died of itself or was killed; one that ended with a code has said what is wrong, and would again.
fn crashed(child: &Child) -> bool {
    child.ended.is_some_and(|status| status.code().is_none_or(|code| code == PANICKED))
}
