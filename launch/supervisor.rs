//! Starts the stages of a pipeline as processes, watches them and stops them. No child outlives it.

use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child as Process, Command, ExitStatus};
use std::time::{Duration, Instant};

use evac_config::{Pipeline, StageEntry};
use evac_frames::{Ack, Health, StageState};
use evac_ports::services::SinkAck;
use evac_ports::{Bus, Domain, DomainLock, Listener, RecordSubscriber};
use evac_stage::LogOptions;
use rustix::process::{Pid, Signal, kill_process};

use crate::error::LaunchError;
use crate::health_board::HealthBoard;
use crate::registry::{Role, kind};

/// How long a stage may take until its ports are open.
const START_PATIENCE: Duration = Duration::from_secs(30);
/// How long a stage may take to end after SIGTERM; sinks write their files in this time.
const STOP_PATIENCE: Duration = Duration::from_secs(60);
const POLL: Duration = Duration::from_millis(20);

/// A running pipeline.
#[derive(Debug)]
pub(crate) struct Supervisor {
    children: Vec<Child>,
    board: HealthBoard,
    acks: RecordSubscriber<SinkAck>,
    pub(crate) bus: Bus,
    /// Dropped last: it removes what the domain left behind.
    _lock: DomainLock,
}

#[derive(Debug)]
struct Child {
    name: String,
    role: Role,
    process: Process,
    ended: Option<ExitStatus>,
}

/// What a running pipeline is doing.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    Running,
    /// Every sink has written everything.
    Finished,
}

impl Supervisor {
    /// Starts all stages: consumers and processors first, producers when all others are ready, so that no frame is missed.
    /// Gives the listeners that wake whoever watches it.
    pub(crate) fn start(
        pipeline: &Pipeline,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
    ) -> Result<(Self, Vec<Listener>), LaunchError> {
        let lock = domain.lock()?;
        let bus = Bus::join(domain, "launcher")?;
        bus.clean_up_dead();
        let (board, health_listener) = HealthBoard::open(&bus)?;
        let (acks, ack_listener) = RecordSubscriber::open(&bus)?;
        let mut supervisor = Self { children: Vec::new(), board, acks, bus, _lock: lock };
        for role in [Role::Consumer, Role::Processor, Role::Producer] {
            for entry in &pipeline.stages {
                if kind(&entry.kind)?.role == role {
                    supervisor.spawn(entry, role, file, domain, log)?;
                }
            }
            // A producer may be through before anyone has looked.
            if role != Role::Producer {
                supervisor.wait_until_ready()?;
            }
        }
        Ok((supervisor, vec![ack_listener, health_listener]))
    }

    fn spawn(
        &mut self,
        entry: &StageEntry,
        role: Role,
        file: &Path,
        domain: &Domain,
        log: &LogOptions,
    ) -> Result<(), LaunchError> {
        let (executable, arguments) = executable(entry)?;
        let mut command = Command::new(&executable);
        command
            .args(arguments)
            .arg("--config")
            .arg(file)
            .args(["--name", entry.name(), "--domain", domain.name()])
            .args(["--die-with-parent".to_owned(), std::process::id().to_string()])
            .args(log.as_args())
            // Of its own, so that Ctrl-C reaches the launcher only and the stages are stopped in order.
            .process_group(0);
        let process = command.spawn().map_err(|cause| {
            LaunchError::Path(format!(
                "cannot start stage '{}' ({}): {cause}; check run in the pipeline file",
                entry.name(),
                executable.display()
            ))
        })?;
        tracing::debug!(stage = entry.name(), pid = process.id(), "started");
        self.children.push(Child { name: entry.name().to_owned(), role, process, ended: None });
        Ok(())
    }

    fn wait_until_ready(&mut self) -> Result<(), LaunchError> {
        let until = Instant::now() + START_PATIENCE;
        loop {
            self.watch()?;
            let late = self.children.iter().find(|child| {
                let health = self.board.get(&child.name);
                health.is_none_or(|health| health.pid != child.process.id())
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

    /// Looks after the children and their reports.
    pub(crate) fn watch(&mut self) -> Result<Progress, LaunchError> {
        self.board.take_in()?;
        for child in &mut self.children {
            if child.ended.is_none() {
                child.ended = child.process.try_wait().map_err(|cause| lost(&child.name, &cause))?;
            }
        }
        // The stage that failed first is the cause; others may follow because of it.
        let failed = self.children.iter().find(|child| child.ended.is_some_and(|status| !status.success()));
        if let Some(child) = failed {
            return Err(child.failure());
        }
        // A producer may be through, a sink may have written everything; a processor ends only when it is told to.
        if let Some(child) = self.children.iter().find(|c| c.role == Role::Processor && c.ended.is_some()) {
            return Err(LaunchError::Silent(format!(
                "stage '{}' ended although it was not told to",
                child.name
            )));
        }
        let mut sinks = self.children.iter().filter(|child| child.role == Role::Consumer).peekable();
        let finished = sinks.peek().is_some() && sinks.all(|child| child.ended.is_some());
        Ok(if finished { Progress::Finished } else { Progress::Running })
    }

    /// Acknowledgements of the sinks since the last call.
    pub(crate) fn take_ack(&mut self) -> Result<Option<Ack>, LaunchError> {
        Ok(self.acks.receive()?)
    }

    /// Scans that the producer will send in all, where it knows.
    pub(crate) fn total_scans(&self) -> Option<u64> {
        let producers = self.children.iter().filter(|child| child.role == Role::Producer);
        producers
            .filter_map(|child| self.board.get(&child.name))
            .map(|health| health.total)
            .find(|total| *total > 0)
    }

    /// Newest report of every stage.
    pub(crate) fn board(&self) -> &HealthBoard {
        &self.board
    }

    /// Ends all stages in the order of the data's flow, so that what is under way is still written.
    pub(crate) fn stop(&mut self) -> Result<(), LaunchError> {
        let mut result = Ok(());
        for role in [Role::Producer, Role::Processor, Role::Consumer] {
            let ended = self.stop_role(role);
            result = result.and(ended);
        }
        // The last reports came while the stages ended.
        self.board.take_in()?;
        result
    }

    fn stop_role(&mut self, role: Role) -> Result<(), LaunchError> {
        for child in self.children.iter().filter(|child| child.role == role && child.ended.is_none()) {
            child.signal(Signal::TERM);
        }
        let until = Instant::now() + STOP_PATIENCE;
        let mut result = Ok(());
        for child in self.children.iter_mut().filter(|child| child.role == role && child.ended.is_none()) {
            while child.ended.is_none() {
                self.board.take_in()?;
                child.ended = child.process.try_wait().map_err(|cause| lost(&child.name, &cause))?;
                if child.ended.is_none() && Instant::now() > until {
                    tracing::warn!(stage = child.name, "did not end after SIGTERM and is killed");
                    child.signal(Signal::KILL);
                    child.ended = Some(child.process.wait().map_err(|cause| lost(&child.name, &cause))?);
                }
                std::thread::sleep(POLL);
            }
            if child.ended.is_some_and(|status| !status.success()) {
                result = result.and(Err(child.failure()));
            }
        }
        result
    }
}

impl Drop for Supervisor {
    /// Whatever went wrong: no child outlives the launcher.
    fn drop(&mut self) {
        for child in self.children.iter_mut().filter(|child| child.ended.is_none()) {
            child.signal(Signal::TERM);
        }
        let until = Instant::now() + Duration::from_secs(5);
        for child in self.children.iter_mut().filter(|child| child.ended.is_none()) {
            while Instant::now() < until && matches!(child.process.try_wait(), Ok(None)) {
                std::thread::sleep(POLL);
            }
            child.signal(Signal::KILL);
            // The child is gone either way; there is nobody left to tell.
            let _ = child.process.wait();
        }
        self.bus.clean_up_dead();
    }
}

impl Child {
    fn signal(&self, signal: Signal) {
        let pid = i32::try_from(self.process.id()).ok().and_then(Pid::from_raw);
        if let Some(pid) = pid
            && let Err(cause) = kill_process(pid, signal)
        {
            tracing::debug!(stage = self.name, %cause, "already gone");
        }
    }

    fn failure(&self) -> LaunchError {
        use std::os::unix::process::ExitStatusExt as _;
        let status = self.ended.unwrap_or_default();
        match status.code() {
            Some(code @ 1..=5) => {
                LaunchError::Child { name: self.name.clone(), code: u8::try_from(code).unwrap_or(1) }
            }
            Some(code) => LaunchError::Silent(format!("stage '{}' ended with code {code}", self.name)),
            None => LaunchError::Silent(format!(
                "stage '{}' was killed by signal {}; look for memory shortage (dmesg) or who killed it",
                self.name,
                status.signal().unwrap_or(0)
            )),
        }
    }
}

fn lost(name: &str, cause: &std::io::Error) -> LaunchError {
    LaunchError::Silent(format!("stage '{name}' cannot be watched: {cause}"))
}

/// A stage of evac's own runs from this executable; another is named in the pipeline file.
fn executable(entry: &StageEntry) -> Result<(PathBuf, Vec<PathBuf>), LaunchError> {
    match entry.run.as_deref() {
        Some([executable, arguments @ ..]) => Ok((executable.clone(), arguments.to_vec())),
        _ => {
            let own = std::env::current_exe()
                .map_err(|cause| LaunchError::Path(format!("cannot find my own executable: {cause}")))?;
            Ok((own, vec![PathBuf::from("stage"), PathBuf::from(&entry.kind)]))
        }
    }
}

/// Names of the stages that report frames lost, with their numbers.
pub(crate) fn losses(board: &HealthBoard) -> Vec<String> {
    board
        .all()
        .filter(|(_, health)| health.lost + health.late > 0)
        .map(|(name, health)| format!("{name}: {} lost, {} late", health.lost, health.late))
        .collect()
}

/// The reason a stage gave for failing, if one did.
pub(crate) fn failure_reason(board: &HealthBoard) -> Option<String> {
    board
        .all()
        .find(|(_, health)| health.state == StageState::Failed as u32)
        .map(|(name, health)| format!("{name}: {}", Health::text_of(&health.reason)))
}

/// Stopping by a signal is not a failure of the pipeline, but the work is not done.
pub(crate) fn interrupted() -> LaunchError {
    LaunchError::Silent(
        "stopped by a signal before the walk had ended; the files hold what was mapped".to_owned(),
    )
}
