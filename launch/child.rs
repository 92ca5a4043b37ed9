//! One process of a stage.

use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child as Process, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use evac_config::StageEntry;
use evac_ports::{Domain, Ringer, now_ns};
use evac_stage::LogOptions;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

use crate::error::LaunchError;
use crate::registry::{SOURCES, kind};

/// One process of a stage.
#[derive(Debug)]
pub(crate) struct Child {
    /// Name of the stage; its instances share it.
    pub(crate) name: String,
    pub(crate) epoch: u32,
    process: Process,
    pub(crate) ended: Option<ExitStatus>,
    /// Host monotonic time of its end, 0 before: seen by the thread that waits for it.
    died_ns: Arc<AtomicI64>,
    /// It has reported itself, and was told the routes then.
    pub(crate) greeted: bool,
    /// Why it was killed, where it hung.
    pub(crate) hung: Option<String>,
}

/// How a child is started.
#[derive(Debug, Clone)]
pub(crate) struct Surroundings {
    pub(crate) domain: Domain,
    pub(crate) log: LogOptions,
    pub(crate) ringer: Ringer,
    /// Folder of the journals, where stages that crash are started again.
    pub(crate) journals: Option<PathBuf>,
    /// A source waits for lines, which the launcher hands on: in a process group of its own it may not read a terminal.
    pub(crate) step: bool,
}

impl Child {
    pub(crate) fn spawn(
        entry: &StageEntry,
        file: &Path,
        (epoch, standby): (u32, bool),
        around: &Surroundings,
    ) -> Result<Self, LaunchError> {
        let more: &[&str] = if standby { &["--standby"] } else { &[] };
        Self::spawn_with(entry, file, epoch, more, around)
    }

    /// A producer that counts from `first_seq`.
    pub(crate) fn spawn_producer(
        entry: &StageEntry,
        file: &Path,
        (epoch, first_seq): (u32, u64),
        around: &Surroundings,
    ) -> Result<Self, LaunchError> {
        Self::spawn_with(entry, file, epoch, &["--first-seq", &first_seq.to_string()], around)
    }

    fn spawn_with(
        entry: &StageEntry,
        file: &Path,
        epoch: u32,
        more: &[&str],
        around: &Surroundings,
    ) -> Result<Self, LaunchError> {
        let (executable, arguments) = executable(entry)?;
        let mut command = Command::new(&executable);
        command
            .args(arguments)
            .arg("--config")
            .arg(file)
            .args(["--name", entry.name(), "--domain", around.domain.name()])
            .args(["--die-with-parent".to_owned(), std::process::id().to_string()])
            .args(around.log.as_args())
            // Of its own, so that Ctrl-C reaches the launcher only and the stages are stopped in order.
            .process_group(0);
        // Whoever knows nothing of swaps need not know these options.
        if epoch > 0 {
            command.args(["--epoch".to_owned(), epoch.to_string()]);
        }
        command.args(more);
        if let Some(folder) = &around.journals
            && entry.run.is_none()
            && kind(&entry.kind)?.journaled
        {
            command.arg("--journal").arg(folder.join(entry.name()));
        }
        let steps = around.step && SOURCES.contains(&entry.kind.as_str());
        if steps {
            command.stdin(Stdio::piped());
        }
        let mut process = command.spawn().map_err(|cause| {
            LaunchError::Path(format!(
                "cannot start stage '{}' ({}): {cause}; check run in the pipeline file",
                entry.name(),
                executable.display()
            ))
        })?;
        tracing::debug!(stage = entry.name(), epoch, pid = process.id(), "started");
        let died_ns = Arc::new(AtomicI64::new(0));
        ring_at_end(process.id(), around.ringer.clone(), died_ns.clone());
        if let Some(to_child) = process.stdin.take() {
            hand_on_lines(to_child);
        }
        let name = entry.name().to_owned();
        Ok(Self { name, epoch, process, ended: None, died_ns, greeted: false, hung: None })
    }

    pub(crate) fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Host monotonic time of its end; now where nobody has seen it.
    pub(crate) fn died_ns(&self) -> i64 {
        match self.died_ns.load(Ordering::Relaxed) {
            0 => now_ns(),
            seen => seen,
        }
    }

    /// Takes note of its end. What it has started itself (a stage may be a script) ends with it.
    pub(crate) fn look(&mut self) -> Result<(), LaunchError> {
        if self.ended.is_none() {
            self.ended = self.process.try_wait().map_err(|cause| self.lost(&cause))?;
            if self.ended.is_some() {
                self.signal(Signal::KILL);
            }
        }
        Ok(())
    }

    /// Ends it at once.
    pub(crate) fn kill(&mut self) -> Result<(), LaunchError> {
        if self.ended.is_none() {
            self.signal(Signal::KILL);
            self.ended = Some(self.process.wait().map_err(|cause| self.lost(&cause))?);
        }
        Ok(())
    }

    /// Sends a signal to it and to what it has started itself.
    pub(crate) fn signal(&self, signal: Signal) {
        let group = i32::try_from(self.process.id()).ok().and_then(Pid::from_raw);
        if let Some(group) = group
            && let Err(cause) = kill_process_group(group, signal)
        {
            tracing::debug!(stage = self.name, %cause, "already gone");
        }
    }

    /// Why it ended, if not as it should.
    pub(crate) fn failure(&self) -> LaunchError {
        use std::os::unix::process::ExitStatusExt as _;
        if let Some(reason) = &self.hung {
            return LaunchError::Silent(reason.clone());
        }
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

    fn lost(&self, cause: &std::io::Error) -> LaunchError {
        LaunchError::Silent(format!("stage '{}' cannot be watched: {cause}", self.name))
    }
}

/// Rings when the child has ended, and leaves it for the launcher to take note of.
fn ring_at_end(pid: u32, ringer: Ringer, died_ns: Arc<AtomicI64>) {
    let Some(pid) = i32::try_from(pid).ok().and_then(Pid::from_raw) else { return };
    let watch = move || {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT;
        while matches!(waitid(WaitId::Pid(pid), options), Err(rustix::io::Errno::INTR)) {}
        died_ns.store(now_ns(), Ordering::Relaxed);
        ringer.ring();
    };
    // Without the thread its end is seen a fraction of a second later.
    drop(std::thread::Builder::new().name("child".to_owned()).spawn(watch));
}

/// Copies standard input to a child, to its end or the child's.
fn hand_on_lines(mut to_child: ChildStdin) {
    let copy = move || std::io::copy(&mut std::io::stdin().lock(), &mut to_child);
    // Without the thread the child's input ends at once, and it goes on without steps.
    drop(std::thread::Builder::new().name("steps".to_owned()).spawn(copy));
}

/// A stage of evac's own runs from this executable; another is named in the pipeline file.
pub(crate) fn executable(entry: &StageEntry) -> Result<(PathBuf, Vec<PathBuf>), LaunchError> {
    match entry.run.as_deref() {
        Some([executable, arguments @ ..]) => Ok((executable.clone(), arguments.to_vec())),
        _ => {
            let own = std::env::current_exe()
                .map_err(|cause| LaunchError::Path(format!("cannot find my own executable: {cause}")))?;
            Ok((own, vec![PathBuf::from("stage"), PathBuf::from(&entry.kind)]))
        }
    }
}
