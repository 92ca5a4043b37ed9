//! A fault under way: what is done to a stage, and when the pipeline is whole again.

use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use evac_ports::Domain;
use rustix::process::{Pid, Signal, kill_process_group};

use super::ChaosArgs;
use super::fault::{Deed, Dice};
use super::monitor::Seen;
use super::report::Fault;
use super::shadow;
use crate::child::Child;
use crate::control::{self, Order, Request};
use crate::incidents::Incident;
use crate::registry::ODOMETRIES;
use crate::supervisor::Supervisor;

/// A pipeline that is not whole again after twice this is broken, and a request may take as long as this.
pub(super) const PATIENCE: Duration = Duration::from_secs(90);
/// Two of these are a stutter's period.
const STUTTER: Duration = Duration::from_millis(50);
const SLOW: Duration = Duration::from_secs(2);
/// Frames that the sinks are to get beyond what was there.
const FRAMES: u64 = 3;

/// A fault under way.
pub(super) struct Active {
    pub(super) fault: Fault,
    started: Instant,
    /// A stage that is stopped now, and when it goes on.
    stopped: Option<(u32, Instant)>,
    /// A stutter ends here.
    until: Instant,
    /// What was asked of the launcher: a remark on what came of it, or why nothing did.
    answer: Option<Receiver<Result<Option<String>, String>>>,
    /// Sinks have to get as far.
    wanted: u64,
}

/// How a fault stands.
pub(super) enum Stand {
    UnderWay,
    Whole,
    /// What must not be.
    Broken(String),
}

impl Active {
    /// Does something to a stage.
    pub(super) fn strike(
        (stage, deed): (&'static str, Deed),
        supervisor: &Supervisor,
        newest: u64,
        dice: &mut Dice,
        args: &ChaosArgs,
    ) -> Option<Self> {
        let slot = supervisor.slots.iter().find(|slot| slot.name() == stage)?;
        let child = leader(supervisor, stage)?;
        let now = Instant::now();
        tracing::info!(stage, deed = deed.name(), frame = newest, "chaos");
        let mut active = Self {
            fault: Fault { stage: stage.to_owned(), deed, at_frame: newest, whole_s: None, remark: None },
            started: now,
            stopped: None,
            until: now,
            answer: None,
            wanted: newest + FRAMES,
        };
        match deed {
            Deed::Kill => child.signal(Signal::KILL),
            Deed::Freeze => child.signal(Signal::STOP),
            Deed::Pause | Deed::Slow => {
                child.signal(Signal::STOP);
                let pause = Duration::from_millis(300 + dice.below(1200));
                let first = if deed == Deed::Pause { pause } else { STUTTER };
                active.stopped = Some((child.pid(), now + first));
                active.until = if deed == Deed::Pause { now } else { now + SLOW };
            }
            Deed::Swap | Deed::KillBesideStandby | Deed::Shadow => {
                let is_odometry = ODOMETRIES.contains(&slot.entry.kind.as_str());
                let other = ODOMETRIES.iter().find(|kind| **kind != slot.entry.kind);
                let changes = args.loam && is_odometry && deed != Deed::KillBesideStandby;
                let request = Request {
                    order: match deed {
                        Deed::Swap => Order::Swap,
                        Deed::Shadow => Order::Shadow,
                        _ => Order::Standby,
                    },
                    stage: stage.to_owned(),
                    kind: other.filter(|_| changes).map(|kind| (*kind).to_owned()),
                    run: None,
                    config: None,
                    patience_s: PATIENCE.as_secs_f64(),
                };
                let promote = dice.below(2) == 0;
                let (domain, args) = (supervisor.around.domain.clone(), args.clone());
                let (say, hear) = channel();
                std::thread::spawn(move || say.send(carry_out(&domain, &request, &args, promote)));
                active.answer = Some(hear);
            }
        }
        Some(active)
    }

    /// Carries it on as far as it goes now.
    pub(super) fn step(&mut self, supervisor: &Supervisor, seen: &Seen, incidents: &[Incident]) -> Stand {
        let now = Instant::now();
        if let Some((pid, until)) = self.stopped
            && now >= until
        {
            signal(pid, Signal::CONT);
            self.stopped = None;
            if now < self.until {
                signal(pid, Signal::STOP);
                self.stopped = Some((pid, now + STUTTER));
            }
            self.wanted = seen.newest() + FRAMES;
        }
        let (stage, deed) = (self.fault.stage.clone(), self.fault.deed);
        if let Some(answer) = self.answer.take_if(|_| true) {
            match answer.try_recv() {
                Ok(Err(cause)) => {
                    return Stand::Broken(format!("{} of {stage} failed: {cause}", deed.name()));
                }
                Ok(Ok(remark)) => {
                    self.fault.remark = remark;
                    self.wanted = seen.newest() + FRAMES;
                    if deed == Deed::KillBesideStandby {
                        (self.fault.at_frame, self.started) = (seen.newest(), now);
                        if let Some(child) = leader(supervisor, &stage) {
                            child.signal(Signal::KILL);
                        }
                    }
                }
                Err(_) => self.answer = Some(answer),
            }
        }
        let busy = self.stopped.is_some() || self.answer.is_some();
        // A stage that is frozen lets the sinks go on for a while only where it is none of theirs: its death is the mark.
        let awaits_death = deed == Deed::Freeze
            && !incidents.iter().any(|incident| {
                incident.stage == stage
                    && incident.last_seq.is_some_and(|last| last + 40 >= self.fault.at_frame)
            });
        if !busy && !awaits_death && seen.acked() > self.wanted {
            self.fault.whole_s = Some(self.started.elapsed().as_secs_f64());
            Stand::Whole
        } else if self.started.elapsed() < 2 * PATIENCE {
            Stand::UnderWay
        } else {
            Stand::Broken(format!(
                "{} of {stage} at frame {}: not whole again after {} s",
                deed.name(),
                self.fault.at_frame,
                2 * PATIENCE.as_secs()
            ))
        }
    }
}

/// Asks the launcher as any user would.
fn carry_out(
    domain: &Domain,
    request: &Request,
    args: &ChaosArgs,
    promote: bool,
) -> Result<Option<String>, String> {
    control::ask(domain, request, |_| ()).map_err(|cause| cause.to_string())?;
    if request.order != Order::Shadow {
        return Ok(None);
    }
    shadow::compare_and_end(domain, &request.stage, args, promote).map(Some)
}

/// The instance that leads.
fn leader<'a>(supervisor: &'a Supervisor, stage: &str) -> Option<&'a Child> {
    let slot = supervisor.slots.iter().find(|slot| slot.name() == stage)?;
    supervisor.child(stage, slot.epoch)
}

fn signal(pid: u32, signal: Signal) {
    let group = i32::try_from(pid).ok().and_then(Pid::from_raw);
    if let Some(group) = group {
        // One that has died meanwhile needs none.
        let _ = kill_process_group(group, signal);
    }
}
