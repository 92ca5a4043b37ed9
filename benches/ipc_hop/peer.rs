//! The other process: this executable once more, which answers every frame.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, Stdio};

use anyhow::Context as _;
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};

use crate::case::{Case, Measure};
use crate::{postcard, shared_memory, socket};

/// First argument of a peer.
const PEER: &str = "--hop-peer";
const READY: &str = "ready";

/// What the other process does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Job {
    /// Answers over shared memory.
    SharedMemory,
    /// Only receives from shared memory.
    Listen,
    /// Answers over a socket.
    Socket,
    /// Answers over a socket what it has deserialised.
    Postcard,
}

impl Job {
    const ALL: [(Self, &'static str); 4] = [
        (Self::SharedMemory, "shared-memory"),
        (Self::Listen, "listen"),
        (Self::Socket, "socket"),
        (Self::Postcard, "postcard"),
    ];
}

/// A running peer; dropping it ends it.
#[derive(Debug)]
pub(crate) struct Peer(Child);

impl Peer {
    /// Starts a peer and waits until it can be sent to.
    ///
    /// # Errors
    /// It did not start.
    pub(crate) fn start(
        job: Job,
        case: &Case,
        domain: &str,
        stdin: impl Into<Stdio>,
    ) -> anyhow::Result<Self> {
        let named = Job::ALL.iter().find(|(known, _)| *known == job);
        let (_, transport) = named.context("a peer's job has no name")?;
        let measure = match case.measure {
            Measure::Transport => "transport",
            Measure::WriteAndSum => "write-and-sum",
        };
        let child = Command::new(std::env::current_exe()?)
            .args([PEER, transport, &case.points.to_string(), measure, domain])
            .stdin(stdin)
            .stdout(Stdio::piped())
            .spawn()
            .context("the peer cannot be started")?;
        let mut peer = Self(child);
        let mut line = String::new();
        let stdout = peer.0.stdout.take().context("the peer has no output")?;
        BufReader::new(stdout).read_line(&mut line)?;
        anyhow::ensure!(line.trim() == READY, "the peer did not get ready");
        Ok(peer)
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        if let Some(pid) = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw) {
            // It may have ended by itself; either way it is reaped here.
            let _ = kill_process(pid, Signal::TERM);
        }
        let _ = self.0.wait();
    }
}

/// Does the peer's work if this process was started as one; false otherwise.
///
/// # Errors
/// The connection failed.
pub(crate) fn serve_if_peer() -> anyhow::Result<bool> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [PEER, transport, points, measure, domain] =
        arguments.iter().map(String::as_str).collect::<Vec<_>>()[..]
    else {
        return Ok(false);
    };
    set_parent_process_death_signal(Some(Signal::TERM))?;
    let measure = if measure == "transport" { Measure::Transport } else { Measure::WriteAndSum };
    let case = Case { points: points.parse()?, measure };
    let named = Job::ALL.iter().find(|(_, name)| *name == transport);
    let (job, _) = named.context("a peer is started with an unknown job")?;
    match job {
        Job::Socket => socket::serve(&case)?,
        Job::Postcard => postcard::serve(&case)?,
        _ if shared_memory::is_large(&case) => {
            shared_memory::serve::<true>(&case, domain, *job == Job::SharedMemory)?
        }
        _ => shared_memory::serve::<false>(&case, domain, *job == Job::SharedMemory)?,
    }
    Ok(true)
}

/// Tells the starter that its frames will be answered from now on.
///
/// # Errors
/// The starter is gone.
pub(crate) fn say_ready() -> anyhow::Result<()> {
    let mut stdout = std::io::stdout();
    writeln!(stdout, "{READY}")?;
    Ok(stdout.flush()?)
}
