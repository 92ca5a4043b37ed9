//! The run loop of processors and consumers.

mod lead;
mod standby;

use std::ops::ControlFlow;
use std::time::Duration;

use evac_frames::{Route, StageState};
use evac_ports::services::Routes;
use evac_ports::{Bus, Listener, RecordSubscriber, Wake, now_ns, wait_on};

use crate::ack::AckPort;
use crate::checkpoint::Checkpoints;
use crate::follow::{Followed, Follower};
use crate::joins::{Join, JoinOptions};
use crate::journal::{Journal, Place, Start};
use crate::options::Context;
use crate::role::{Order, Orders, Role, Standby};
use crate::stage_main::prepare;
use crate::tracer::Tracer;
use crate::{Reporter, RunError, RunOptions, Stage, StageOutput, State};

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
}
