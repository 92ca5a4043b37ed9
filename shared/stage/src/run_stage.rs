//! The run loop of processors and consumers.

use std::ops::ControlFlow;
use std::time::Duration;

use evac_frames::{FrameHeader, Route, StageState, frame_flags};
use evac_ports::services::Routes;
use evac_ports::{Bus, Listener, RecordSubscriber, Wake, now_ns, wait_on};

use crate::ack::AckPort;
use crate::checkpoint::Checkpoints;
use crate::follow::{Followed, Follower};
use crate::joins::{Join, JoinOptions};
use crate::journal::{self, Head, Journal, Place, Start};
use crate::options::Context;
use crate::role::{Order, Orders, Promotion, Role, Standby};
use crate::stage_main::prepare;
use crate::tracer::Tracer;
use crate::{Readiness, Reporter, RunError, RunOptions, Stage, StageError, StageOutput, State};

/// Kinds of odometry stages; a deskewer beside one of them uses its poses as prior.
const ODOMETRY_KINDS: &[&str] = &["lio", "loam"];

/// Where a shadow's output goes.
fn shadow_bus<S: Stage>(context: &Context) -> Result<Bus, RunError> {
    if <S::Output as StageOutput>::IS_SINK {
        return Err(RunError::Value(format!(
            "'{}' writes files, and a shadow would write over them; only processors can be shadows",
            context.name
        )));
    }
    Ok(Bus::join(&context.domain.of_shadows()?, &context.name)?)
}

/// Runs a stage until its stream ends or SIGTERM comes.
///
/// # Errors
/// [`RunError`], with the process's exit code in [`RunError::code`].
pub fn run_stage<S, J>(options: &RunOptions) -> Result<(), RunError>
where
    J: Join,
    S: for<'a> Stage<Input<'a> = J::Frame<'a>>,
{
    let Some((context, config)) = prepare::<S::Config>(S::NAME, options)? else { return Ok(()) };
    let mut stage = S::new(config, &context.rig)?;
    stage.begin(&context.pipeline_text()?)?;
    let mut bus = Bus::join(&context.domain, &context.name)?;
    // Who only writes files can wait for those whose output others wait for.
    if S::Output::SERVICES.is_empty() {
        bus = bus.wake_last();
    }
    let lossless = context.mode == evac_config::Mode::Lossless;
    let join_options = JoinOptions::new(lossless, context.has_kind(ODOMETRY_KINDS));
    let (join, mut listeners) = J::open(&bus, join_options)?;
    let (routes, route_listener) = RecordSubscriber::open(&bus)?;
    listeners.push(route_listener);
    let mut role = Role::Lead;
    let mut state = StageState::Waiting;
    if options.standby || options.shadow {
        let (follower, own_listeners) = <S::Output as Followed>::Follower::open(&bus, &context.name)?;
        listeners.extend(own_listeners);
        role = Role::Follow(Box::new(Standby {
            follower,
            promotion: None,
            shadow: options.shadow,
            ended: false,
            restored: false,
        }));
        state = StageState::Following;
    }
    let shadows = if options.shadow { Some(shadow_bus::<S>(&context)?) } else { None };
    let output_bus = shadows.as_ref().unwrap_or(&bus);
    let output = S::Output::open(output_bus, context.epoch)?;
    listeners.extend(output.listeners(output_bus)?);
    let ack = if <S::Output as StageOutput>::IS_SINK { Some(AckPort::open(&bus, &context)?) } else { None };
    let checkpoints = match ack {
        Some(_) => Some(Checkpoints::open(&bus, &context.domain, &context.name)?),
        None => None,
    };
    let tracer = Tracer::open(&bus, &context.name, context.epoch)?;
    // Last, because it says that everything is open.
    let mut reporter = Reporter::open_as(&bus, &context.name, context.epoch, state)?;
    reporter.tracer = Some(tracer);
    let orders = Orders::new(&context.name, context.epoch);
    let place = options.journal.clone().filter(|_| S::JOURNALED).map(|folder| Place {
        folder,
        lossless,
        max_bytes: context.journal_bytes(),
    });
    let journal = match (&place, &role) {
        (Some(place), Role::Lead) => Some(Journal::open(place, Start::Empty)?),
        _ => None,
    };
    let mut running = Running {
        stage,
        join,
        output,
        ack,
        checkpoints,
        reporter,
        routes,
        orders,
        role,
        place,
        journal,
        read_back: false,
        leads_from: 0,
        last_seq: None,
        ended: false,
    };
    let result = running.run(&bus, &listeners);
    let (state, reason) = match &result {
        Ok(()) if running.role.leads() => (StageState::Finished, String::new()),
        Ok(()) => (StageState::Retired, String::new()),
        Err(error) => (StageState::Failed, error.to_string()),
    };
    // The error itself is what the caller needs to see, not that it could not be reported.
    let reported = running.reporter.end(state, &reason);
    result.and(reported.map_err(RunError::from))
}

struct Running<S: Stage, J> {
    stage: S,
    join: J,
    output: S::Output,
    ack: Option<AckPort>,
    /// A sink's.
    checkpoints: Option<Checkpoints>,
    reporter: Reporter,
    routes: RecordSubscriber<Routes>,
    orders: Orders,
    role: Role<<S::Output as Followed>::Follower>,
    /// Where its journal is, if it keeps one.
    place: Option<Place>,
    /// Of the instance that leads.
    journal: Option<Journal>,
    /// What it goes on with comes from the journal, and no frame has joined it yet.
    read_back: bool,
    /// Frames before it are the older instance's.
    leads_from: u64,
    /// The newest frame that is dealt with, here or by the routed instance.
    last_seq: Option<u64>,
    ended: bool,
}

impl<S, J> Running<S, J>
where
    J: Join,
    S: for<'a> Stage<Input<'a> = J::Frame<'a>>,
{
    fn run(&mut self, bus: &Bus, listeners: &[Listener]) -> Result<(), RunError> {
        wait_on(listeners, |wake| match self.look(bus, wake) {
            Ok(Some(timeout)) => ControlFlow::Continue(timeout),
            Ok(None) => ControlFlow::Break(Ok(())),
            Err(error) => ControlFlow::Break(Err(error)),
        })?
    }

    /// Handles everything that has come; the time until it must look again, `None` when it is done.
    ///
    /// What was handed over before SIGTERM is still handled, what comes after it is not: a stage that is slower than its
    /// input would never end.
    fn look(&mut self, bus: &Bus, wake: Wake) -> Result<Option<Duration>, RunError> {
        let mut stop = wake == Wake::Stop;
        self.take_in()?;
        while !self.ended && self.handle_next()? {
            self.serve()?;
            self.reporter.report_if_due()?;
            if !stop {
                stop = bus.stop_requested();
                self.take_in()?;
            }
        }
        if stop {
            if !self.ended && self.role.leads() {
                self.stage.finish()?;
            }
            return Ok(None);
        }
        self.serve()?;
        if self.ended && self.ack.is_some() {
            return Ok(None);
        }
        // The launcher counts what comes meanwhile.
        if self.role.leads() && !self.ended && self.join.waits() {
            self.reporter.change(StageState::Waiting)?;
        }
        let mut timeout_ns = self.reporter.report_if_due()?;
        if let Some(deadline) = self.join.deadline_ns().filter(|_| !self.ended) {
            timeout_ns = timeout_ns.min((deadline - now_ns()).max(1_000_000));
        }
        Ok(Some(Duration::from_nanos(timeout_ns.unsigned_abs())))
    }

    /// The launcher's words first: when one says that an instance has ended, all that it sent is there.
    fn take_in(&mut self) -> Result<(), RunError> {
        while let Some(route) = self.routes.receive()? {
            self.take_route(&route)?;
        }
        if let Role::Follow(standby) = &mut self.role {
            standby.follower.take_in(&mut self.reporter)?;
        }
        Ok(self.join.take_in(&mut self.reporter)?)
    }

    fn take_route(&mut self, route: &Route) -> Result<(), RunError> {
        self.join.route(route);
        // Where something has changed, somebody is new.
        self.output.greet()?;
        if let Role::Follow(standby) = &mut self.role {
            standby.follower.route(route);
        }
        match (self.orders.of(route), &mut self.role) {
            (Some(Order::Lead(promotion)), Role::Follow(standby)) => standby.promotion = Some(promotion),
            // The one that was to take over has failed.
            (Some(Order::Lead(_)), Role::Retired) => {
                self.role = Role::Lead;
                self.join.limit(u64::MAX);
                self.open_journal(Start::Whole)?;
                self.reporter.change(StageState::Running)?;
            }
            (Some(Order::Retire), Role::Lead) => {
                self.role = Role::Retired;
                self.journal = None;
                self.join.limit(0);
                self.reporter.retire(self.last_seq)?;
            }
            _ => {}
        }
        Ok(())
    }

    fn serve(&mut self) -> Result<(), RunError> {
        // One that has handed over still answers the standby that takes over from it.
        if let (Some(checkpoints), Some(seq), false) =
            (&self.checkpoints, self.last_seq, matches!(self.role, Role::Follow(_)))
            && checkpoints.is_wanted()
        {
            let mut state = State::default();
            self.stage.save_state(&mut state);
            // The standby's loss, not this one's: it goes on asking.
            if let Err(cause) = checkpoints.answer(seq, &state) {
                tracing::warn!(%cause, "the state for a standby cannot be written");
            }
        }
        if self.role.processes() { Ok(self.stage.serve(&mut self.output)?) } else { Ok(()) }
    }

    fn handle_next(&mut self) -> Result<bool, RunError> {
        match &self.role {
            Role::Lead | Role::Shadow => self.process_next(),
            Role::Follow(_) => self.follow_next(),
            Role::Retired => Ok(false),
        }
    }

    /// Processes one complete set, if there is one. A processor whose stream has ended stays until it is told to stop, so
    /// that nothing it has published is taken away before it is read; a sink finishes its files and ends.
    fn process_next(&mut self) -> Result<bool, RunError> {
        let (stage, output, leads_from) = (&mut self.stage, &mut self.output, self.leads_from);
        let read_back = &mut self.read_back;
        let complete_ns = now_ns();
        let handled = self.join.next(&mut self.reporter, |input, frame, reporter| {
            if frame.seq < leads_from {
                stage.follow(input, None)?;
                return Ok(*frame);
            }
            // Readers go on with what was read back only if nothing is missing after it.
            if std::mem::take(read_back) && frame.seq > leads_from {
                output.go_on_with(None);
            }
            reporter.begin();
            stage.process(input, output, &mut reporter.counters)?;
            reporter.odometry = output.odometry();
            if !stage.note().is_empty() {
                reporter.note(stage.note());
            }
            reporter.done(frame, complete_ns);
            Ok::<FrameHeader, StageError>(*frame)
        });
        let Some(frame) = handled.transpose()? else { return Ok(false) };
        if frame.seq < leads_from {
            return Ok(true);
        }
        self.write_down(&frame);
        let Some(frame) = self.join.done(&frame) else { return Ok(true) };
        let awaited = self.last_seq.map_or(frame.seq, |last| last.saturating_add(1));
        if frame.seq > awaited {
            self.reporter.missed(awaited, frame.seq - 1);
        }
        self.last_seq = Some(frame.seq);
        self.ended = frame.flags & frame_flags::END_OF_STREAM != 0;
        if self.ended {
            self.end()?;
        }
        if let Some(ack) = &self.ack {
            ack.send(frame.seq, self.ended)?;
        }
        Ok(true)
    }

    fn write_down(&mut self, frame: &FrameHeader) {
        let Some(journal) = &mut self.journal else { return };
        let head = Head { seq: frame.seq, lineage: self.output.lineage() };
        let goes_on = journal.write(head, |entry, whole| self.stage.write_down(entry, whole));
        self.reporter.journal_dropped = journal.dropped();
        if !goes_on {
            self.journal = None;
            self.reporter.note("the journal has ended, see the log");
        }
    }

    fn open_journal(&mut self, start: Start) -> Result<(), RunError> {
        self.journal = self.place.as_ref().map(|place| Journal::open(place, start)).transpose()?;
        Ok(())
    }

    /// Goes on where an instance was that has been killed, as far as it had written it down.
    fn read_back(&mut self) -> Result<(), RunError> {
        let Some(place) = &self.place else {
            self.join.resume(None);
            return Ok(());
        };
        let stage = &mut self.stage;
        let read = journal::read_back(&place.folder, |entry| stage.read_back(entry))?;
        self.join.resume(read.map(|read| read.head.seq));
        let Some(read) = read else { return self.open_journal(Start::Empty) };
        tracing::info!(frame = read.head.seq, "goes on from the journal");
        self.output.go_on_with(Some(read.head.lineage));
        (self.last_seq, self.read_back) = (Some(read.head.seq), true);
        self.open_journal(Start::After(read))
    }

    fn end(&mut self) -> Result<(), RunError> {
        self.stage.finish()?;
        let state = if self.role.leads() { StageState::Finished } else { StageState::Shadow };
        Ok(self.reporter.end(state, "")?)
    }

    /// Follows the routed instance by one frame, or takes over from it when it was followed to its end.
    fn follow_next(&mut self) -> Result<bool, RunError> {
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
