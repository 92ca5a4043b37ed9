//! The same hop over Zenoh's shared memory. Zenoh is not built with evac: both ends are a program of their own, benches/zenoh.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::Context as _;
use tempfile::TempDir;

use crate::case::{Case, Link, Measure};

/// Where `benches/zenoh/build` puts it.
const PROGRAM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/target/zenoh/release/evac-zenoh-hop");

/// How both ends receive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Receive {
    /// A thread of the program sleeps until a frame comes, as a stage does.
    Thread,
    /// Zenoh calls a function in its own thread, and its low-latency transport is on: as fast as it gets.
    Callback,
}

/// The program, where it is built.
pub(crate) fn program() -> Option<PathBuf> {
    Some(PathBuf::from(PROGRAM)).filter(|path| path.exists())
}

/// Starts both ends.
///
/// # Errors
/// They do not start.
pub(crate) fn connect(case: &Case, receive: Receive) -> anyhow::Result<Box<dyn Link>> {
    let program = program().context("benches/zenoh/build has not been run")?;
    let folder = tempfile::tempdir()?;
    let measure = if case.measure == Measure::Transport { "transport" } else { "write-and-sum" };
    let receive = if receive == Receive::Thread { "thread" } else { "callback" };
    let mut child = Command::new(program)
        .args(["ping", &case.points.to_string(), measure, receive])
        .arg(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    let ends = child.stdin.take().zip(child.stdout.take()).context("a program has no input or output")?;
    Ok(Box::new(Zenoh { requests: Some(ends.0), times: BufReader::new(ends.1), child, _folder: folder }))
}

/// The first end; dropping it ends both.
struct Zenoh {
    /// None when it is to end.
    requests: Option<ChildStdin>,
    times: BufReader<ChildStdout>,
    child: Child,
    _folder: TempDir,
}

impl Link for Zenoh {
    fn round_trips(&mut self, count: u64, record: &mut dyn FnMut(i64)) -> anyhow::Result<()> {
        let requests = self.requests.as_mut().context("it has ended")?;
        writeln!(requests, "{count}")?;
        let mut line = String::new();
        for _ in 0..count {
            line.clear();
            self.times.read_line(&mut line)?;
            record(line.trim().parse().context("Zenoh's end of the hop has failed")?);
        }
        Ok(())
    }
}

impl Drop for Zenoh {
    fn drop(&mut self) {
        // The end of its input; it frees its shared memory before it ends.
        self.requests = None;
        let _ = self.child.wait();
    }
}
