//! What a launcher that was killed has left in its domain: found and cleaned by the next one, which says what it was.
//!
//! Its stages end with it (parent-death signal) and are given time to write their files. One that was stopped or does not care is
//! killed. Shared memory of the dead is freed, and the files of the domain's folder are removed.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use evac_formats::write_for_this_boot;
use evac_ports::Domain;
use rustix::process::{Pid, Signal, kill_process_group, test_kill_process};
use serde::{Deserialize, Serialize};

use crate::child::Child;

/// How long the stages of a launcher that was killed may write their files.
const PATIENCE: Duration = Duration::from_secs(20);
const POLL: Duration = Duration::from_millis(20);

/// A process as it is remembered: its number may be another one's later, its number and start time not.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Entry {
    stage: String,
    pid: u32,
    /// Ticks after the machine's start.
    started: u64,
}

/// The list of a launcher's processes, in the domain's folder.
#[derive(Debug, Default)]
pub(crate) struct Roll {
    written: Vec<u32>,
}

impl Roll {
    /// Writes it down where it has changed.
    pub(crate) fn keep(&mut self, domain: &Domain, children: &[Child]) {
        let alive = || children.iter().filter(|child| child.ended.is_none());
        if self.written.iter().copied().eq(alive().map(Child::pid)) {
            return;
        }
        self.written = alive().map(Child::pid).collect();
        let entries: Vec<_> = alive()
            .filter_map(|child| {
                let (pid, started) = (child.pid(), started(child.pid())?.0);
                Some(Entry { stage: child.name.clone(), pid, started })
            })
            .collect();
        let json = serde_json::to_vec(&entries).unwrap_or_default();
        let file = domain.folder().join(FILE);
        if let Err(cause) = write_for_this_boot(&file, |writer| std::io::Write::write_all(writer, &json)) {
            tracing::warn!(%cause, "the next launcher will not know this one's stages");
        }
    }
}

const FILE: &str = "children.json";

/// What was found.
#[derive(Debug, Default)]
pub(crate) struct Aftermath {
    launcher: Option<u32>,
    ended: Vec<String>,
    killed: Vec<String>,
    socket: bool,
    shared: (usize, u64),
}

impl Aftermath {
    /// Looks who was here; before the domain is locked.
    pub(crate) fn find(domain: &Domain) -> Self {
        Self {
            launcher: domain.left_by(),
            socket: domain.folder().join("control.sock").exists(),
            shared: domain.shared_memory(),
            ..Self::default()
        }
    }

    /// Ends what still runs and removes what is nobody's any more; the domain is locked, so nobody uses it.
    pub(crate) fn clean(&mut self, domain: &Domain) {
        if self.launcher.is_none() {
            return;
        }
        let entries: Vec<Entry> = fs::read(domain.folder().join(FILE))
            .ok()
            .and_then(|json| serde_json::from_slice(&json).ok())
            .unwrap_or_default();
        let until = Instant::now() + PATIENCE;
        for entry in entries {
            let Some(state) = state_of(&entry) else { continue };
            let name = format!("{} (pid {})", entry.stage, entry.pid);
            let mut state = Some(state);
            // One that is stopped has not heard that it shall end.
            while state.is_some_and(|state| state != 'T') && Instant::now() < until {
                std::thread::sleep(POLL);
                state = state_of(&entry);
            }
            match (state, i32::try_from(entry.pid).ok().and_then(Pid::from_raw)) {
                (Some(_), Some(group)) => {
                    // Gone in this moment is gone.
                    let _ = kill_process_group(group, Signal::KILL);
                    while state_of(&entry).is_some() && test_kill_process(group).is_ok() {
                        std::thread::sleep(POLL);
                    }
                    self.killed.push(name);
                }
                _ => self.ended.push(name),
            }
        }
        for entry in fs::read_dir(domain.folder()).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_ours = [".toml", ".json", ".state", ".wanted"].iter().any(|end| name.ends_with(end));
            if is_ours {
                remove(&entry.path());
            }
        }
    }

    /// Says it, once the shared memory is freed.
    pub(crate) fn say(&self, domain: &Domain) {
        let Some(launcher) = self.launcher else { return };
        let (files, bytes) = self.shared;
        let (files_left, bytes_left) = domain.shared_memory();
        let list = |names: &[String]| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        tracing::warn!(
            "the launcher with pid {launcher} was killed in this domain; stages that still ran: {}; killed: {}; \
             shared memory freed: {} files, {:.1} MiB; control socket: {}",
            list(&self.ended),
            list(&self.killed),
            files.saturating_sub(files_left),
            bytes.saturating_sub(bytes_left) as f64 / f64::from(1 << 20),
            if self.socket { "replaced" } else { "none" },
        );
    }
}

fn remove(path: &Path) {
    if let Err(cause) = fs::remove_file(path) {
        tracing::warn!(path = %path.display(), %cause, "left behind");
    }
}

/// Start time and state of a process.
fn started(pid: u32) -> Option<(u64, char)> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // After the name, which may hold anything.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    let state = fields.next()?.chars().next()?;
    Some((fields.nth(18)?.parse().ok()?, state))
}

/// The state of a process that still runs.
fn state_of(entry: &Entry) -> Option<char> {
    let (started, state) = started(entry.pid)?;
    (started == entry.started && !matches!(state, 'Z' | 'X')).then_some(state)
}
