//! A producer is replaced: one at a time has the sensor, so the new one starts when the old one has ended, and counts on. A recording or
//! a simulated walk goes on with the scan at which it ended and loses nothing; of a device what it said meanwhile is lost. Either
//! way the gap is stated.

use std::time::{Duration, Instant};

use evac_config::StageEntry;
use evac_frames::Route;
use rustix::process::Signal;

use crate::child::Child;
use crate::control::{Order, Outcome, Reply, Request};
use crate::error::LaunchError;
use crate::pulse::{Beat, Line, line_of};
use crate::registry::{Role, SOURCES};
use crate::supervisor::Supervisor;

/// How long the old instance may take to give its device back.
const END_PATIENCE: Duration = Duration::from_secs(10);

/// A producer on its way from one instance to the next.
#[derive(Debug)]
pub(crate) struct Replacement {
    slot: usize,
    entry: StageEntry,
    /// Who asked for it; nobody where the old one has died.
    reply: Option<Reply>,
    started: Instant,
    until: Instant,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    /// The old one has been told to end.
    Ending,
    /// It has ended.
    Due(Instant),
    /// The new one has been started.
    Starting { epoch: u32, pid: u32, last_seq: Option<u64>, ended: Instant },
}

impl Supervisor {
    /// The slot of the producer of that name.
    pub(crate) fn producer(&self, name: &str) -> Option<usize> {
        self.slots.iter().position(|slot| slot.name() == name && slot.role == Role::Producer)
    }

    /// Takes up a request that is about a producer, or says why not.
    pub(crate) fn take_producer_request(&mut self, slot: usize, request: &Request, mut reply: Reply) {
        if request.order != Order::Swap {
            return reply.fail(&format!(
                "'{}' is a producer, of which one at a time has the sensor; it is started again when it dies",
                request.stage
            ));
        }
        let entry = self.entry_for(slot, request).and_then(|entry| {
            let mut pipeline = self.pipeline.clone();
            if let Some(place) = pipeline.stages.get_mut(slot) {
                place.clone_from(&entry);
            }
            crate::check::check(&pipeline).map_err(LaunchError::Path)?;
            Ok(entry)
        });
        match entry {
            Err(cause) => reply.fail(&cause.to_string()),
            Ok(_) if self.replacements.iter().any(|other| other.slot == slot) => {
                reply.fail("it is being replaced already; ask again when that is through");
            }
            Ok(entry) => {
                reply.progress(&format!("'{}' is told to end", entry.name()));
                if let Some(child) = self.leader(slot) {
                    child.signal(Signal::TERM);
                }
                let now = Instant::now();
                let patience = Duration::try_from_secs_f64(request.patience_s).unwrap_or(END_PATIENCE);
                let until = now.checked_add(patience).unwrap_or(now + END_PATIENCE);
                self.replacements.push(Replacement {
                    slot,
                    entry,
                    reply: Some(reply),
                    started: now,
                    until,
                    phase: Phase::Ending,
                });
            }
        }
    }

    /// Plans a new instance in the place of one that has died.
    pub(crate) fn replace_dead_producer(&mut self, slot: usize, wait: Duration) {
        let Some(entry) = self.slots.get(slot).map(|slot| slot.entry.clone()) else { return };
        let now = Instant::now();
        let phase = Phase::Due(now + wait);
        self.replacements.retain(|other| other.slot != slot || other.reply.is_some());
        self.replacements.push(Replacement {
            slot,
            entry,
            reply: None,
            started: now,
            until: now + wait + END_PATIENCE,
            phase,
        });
    }

    /// Whether a producer is between two instances: its end is no failure.
    pub(crate) fn is_replacing(&self, name: &str) -> bool {
        self.replacements.iter().any(|replacement| {
            replacement.entry.name() == name && !matches!(replacement.phase, Phase::Starting { .. })
        })
    }

    fn leader(&self, slot: usize) -> Option<&Child> {
        let slot = self.slots.get(slot)?;
        self.child(slot.name(), slot.epoch)
    }

    /// Carries the replacements on.
    pub(crate) fn replace_producers(&mut self) -> Result<(), LaunchError> {
        for replacement in std::mem::take(&mut self.replacements) {
            if let Some(rest) = self.carry_producer_on(replacement)? {
                self.replacements.push(rest);
            }
        }
        Ok(())
    }

    fn carry_producer_on(
        &mut self,
        mut replacement: Replacement,
    ) -> Result<Option<Replacement>, LaunchError> {
        let name = replacement.entry.name().to_owned();
        let Some(old) = self.slots.get(replacement.slot).map(|slot| slot.epoch) else { return Ok(None) };
        match replacement.phase {
            Phase::Ending => {
                let ended = self.child(&name, old).is_none_or(|child| child.ended.is_some());
                if ended || replacement.started.elapsed() > END_PATIENCE {
                    self.end(&name, old)?;
                    replacement.phase = Phase::Due(Instant::now());
                    return self.carry_producer_on(replacement);
                }
            }
            Phase::Due(at) if Instant::now() >= at => {
                let ended = Instant::now();
                self.pulse.take_in()?;
                let line = self.slots.get(replacement.slot).and_then(line_of);
                let newest = line.as_ref().and_then(|line| self.pulse.newest(line, old));
                let before =
                    self.incidents.of_stage(&name).next_back().and_then(|incident| incident.last_seq);
                let last_seq = newest.max(before);
                let (epoch, pid) = self.start_producer(&replacement, line, last_seq)?;
                replacement.phase = Phase::Starting { epoch, pid, last_seq, ended };
            }
            Phase::Due(_) => {}
            Phase::Starting { epoch, pid, last_seq, ended } => {
                let child = self.child(&name, epoch);
                if child.is_none_or(|child| child.ended.is_some()) {
                    // Its death is that of the instance that leads, and handled as such.
                    let why = child.map_or_else(String::new, |child| child.failure().to_string());
                    if let Some(reply) = &mut replacement.reply {
                        reply.fail(&format!("{name}: the new instance has ended: {why}"));
                    }
                    return Ok(None);
                }
                let line = self.slots.get(replacement.slot).and_then(line_of);
                let first = match &line {
                    Some(line) => self.pulse.came(line).and_then(|resumption| resumption.first),
                    None => self
                        .board
                        .of(&name, epoch)
                        .filter(|health| health.frames_out > 0)
                        .map(|health| Beat { seq: health.last_seq, sent_ns: health.last_input_ns }),
                };
                let late = Instant::now() > replacement.until;
                let Some(reply) = &mut replacement.reply else {
                    let through = first.is_some() || late || !self.incidents.open(&name);
                    return Ok(if through { None } else { Some(replacement) });
                };
                if let Some(first) = first {
                    let next = last_seq.map_or(0, |last| last + 1);
                    let lost = match line {
                        None => "its stream begins anew".to_owned(),
                        Some(_) if first.seq > next => {
                            format!("frames {next} to {} are missing", first.seq - 1)
                        }
                        Some(_) => "no frame is missing".to_owned(),
                    };
                    reply.progress(&format!(
                        "nothing came for {:.0} ms; {lost}",
                        ended.elapsed().as_secs_f64() * 1e3
                    ));
                    reply.done(&Outcome {
                        stage: name,
                        kind: replacement.entry.kind.clone(),
                        pid,
                        epoch,
                        from_seq: Some(first.seq),
                        ready_s: replacement.started.elapsed().as_secs_f64(),
                        handover_ms: Some(ended.elapsed().as_secs_f64() * 1e3),
                    });
                    return Ok(None);
                }
                if late {
                    reply.fail(&format!("{name}: the new instance runs (pid {pid}) and has put out nothing yet; look at `evac status`"));
                    return Ok(None);
                }
            }
        }
        Ok(Some(replacement))
    }

    /// Starts the new instance: its route first, as its frames may come at once.
    fn start_producer(
        &mut self,
        replacement: &Replacement,
        line: Option<Line>,
        last_seq: Option<u64>,
    ) -> Result<(u32, u32), LaunchError> {
        let slot = replacement.slot;
        let epoch = self.slots.get_mut(slot).map_or(0, |slot| slot.take_epoch());
        // A recording says its last scan again, which may have reached some of its readers only; a device cannot.
        let repeats = SOURCES.contains(&replacement.entry.kind.as_str());
        let first_seq = match last_seq {
            Some(last) if repeats => last,
            Some(last) => last + 1,
            None => 0,
        };
        if let Some(line) = line {
            self.pulse.want(line, epoch - 1, last_seq);
        }
        self.lead(slot, &replacement.entry, |slot| -> Result<Route, LaunchError> {
            slot.follow_on(epoch, first_seq)
        })?;
        let file = self.write_pipeline(slot, &replacement.entry, epoch)?;
        let child = Child::spawn_producer(&replacement.entry, &file, (epoch, first_seq), &self.around)?;
        let pid = child.pid();
        self.children.push(child);
        Ok((epoch, pid))
    }
}
