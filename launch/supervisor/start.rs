//! How a pipeline is started: consumers and processors first, producers when all others are ready.

use std::path::Path;
use std::time::{Duration, Instant};

use evac_config::{Pipeline, StageEntry};
use evac_ports::{Bus, Domain, Doorbell, RecordPublisher, RecordSubscriber};
use evac_stage::LogOptions;

use super::{POLL, Supervisor, Wakeups};
use crate::aftermath::{Aftermath, Roll};
use crate::child::{Child, Surroundings};
use crate::control::Server;
use crate::error::LaunchError;
use crate::health_board::HealthBoard;
use crate::incidents::Incidents;
use crate::pulse::Pulse;
use crate::registry::Role;
use crate::restart::Restarts;
use crate::shadow::Shadows;
use crate::silence::Silence;
use crate::slot::Slot;
use crate::watch::Watch;

/// How long a stage may take until its ports are open.
const START_PATIENCE: Duration = Duration::from_secs(30);

impl Supervisor {
    /// Starts all stages: consumers and processors first, producers when all others are ready, so that no frame is missed.
    pub(crate) fn start(
        pipeline: &Pipeline,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
    ) -> Result<(Self, Wakeups), LaunchError> {
        Self::start_stages(pipeline, file, domain, log, false)
    }

    /// As [`Self::start`], where a stage that crashes is started again instead of ending the pipeline.
    pub(crate) fn start_lasting(
        pipeline: &Pipeline,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
    ) -> Result<(Self, Wakeups), LaunchError> {
        Self::start_stages(pipeline, file, domain, log, true)
    }

    fn start_stages(
        pipeline: &Pipeline,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
        lasting: bool,
    ) -> Result<(Self, Wakeups), LaunchError> {
        let mut aftermath = Aftermath::find(domain);
        let lock = domain.lock()?;
        aftermath.clean(domain);
        Shadows::clean_up(domain)?;
        let bus = Bus::join(domain, "launcher")?;
        bus.clean_up_dead();
        aftermath.say(domain);
        let (board, health_listener) = HealthBoard::open(&bus)?;
        let (acks, ack_listener) = RecordSubscriber::open(&bus)?;
        let bell = Doorbell::new()?;
        let mut supervisor = Self {
            pipeline: pipeline.clone(),
            slots: pipeline.stages.iter().map(Slot::new).collect::<Result<_, _>>()?,
            children: Vec::new(),
            board,
            around: Surroundings {
                domain: domain.clone(),
                log: *log,
                ringer: bell.ringer(),
                journals: lasting.then(|| journals(pipeline, domain)).flatten(),
                step: pipeline.step,
            },
            operation: None,
            replacements: Vec::new(),
            shadows: Shadows::default(),
            restarts: if lasting { Some(Restarts::open(&bus)?) } else { None },
            incidents: Incidents::of(domain),
            pulse: Pulse::open(&bus)?,
            watch: Watch::default(),
            silence: Silence::default(),
            roll: Roll::default(),
            control: Server::start(domain, bell.ringer())?,
            acks,
            routes: RecordPublisher::open(&bus)?,
            bus,
            _lock: lock,
        };
        for role in [Role::Consumer, Role::Processor, Role::Producer] {
            let entries: Vec<StageEntry> = supervisor
                .slots
                .iter()
                .filter(|slot| slot.role == role)
                .map(|slot| slot.entry.clone())
                .collect();
            for entry in &entries {
                let child = Child::spawn(entry, file, (0, false), &supervisor.around)?;
                supervisor.children.push(child);
            }
            // A producer may be through before anyone has looked.
            if role != Role::Producer {
                supervisor.wait_until_ready()?;
            }
        }
        Ok((supervisor, Wakeups { listeners: vec![ack_listener, health_listener], bell }))
    }

    fn wait_until_ready(&mut self) -> Result<(), LaunchError> {
        let until = Instant::now() + START_PATIENCE;
        loop {
            self.watch()?;
            let late = self.children.iter().find(|child| {
                let health = self.board.get(&child.name);
                health.is_none_or(|health| health.pid != child.pid())
            });
            let Some(late) = late else { return Ok(()) };
            if Instant::now() > until {
                return Err(LaunchError::Silent(format!(
                    "stage '{}' was not ready after {} s; run it by hand with --log-level debug",
                    late.name,
                    START_PATIENCE.as_secs()
                )));
            }
            if self.bus.stop_requested() {
                return Err(LaunchError::Silent("stopped before all stages were ready".to_owned()));
            }
            std::thread::sleep(POLL);
        }
    }
}

/// Folder of a domain's journals, where the pipeline keeps any.
fn journals(pipeline: &Pipeline, domain: &Domain) -> Option<std::path::PathBuf> {
    let supervision = &pipeline.supervision;
    let folder = match &supervision.state_dir {
        Some(folder) => folder.join(domain.name()),
        None => domain.folder().join("journal"),
    };
    supervision.journal.then(|| std::path::absolute(&folder).unwrap_or(folder))
}
