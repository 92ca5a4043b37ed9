//! The launcher's side: a thread that reads requests and rings.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use evac_ports::{Domain, Ringer};

use super::{Answer, Outcome, Request, StageWord, socket};
use crate::error::LaunchError;

/// A request is one line and comes at once.
const LONGEST_REQUEST: u64 = 65_536;
const PATIENCE: Duration = Duration::from_secs(2);

/// Requests that have come.
#[derive(Debug)]
pub(crate) struct Server {
    requests: Receiver<(Request, Reply)>,
}

impl Server {
    /// Listens in the domain's folder. The thread ends with the process.
    pub(crate) fn start(domain: &Domain, ringer: Ringer) -> Result<Self, LaunchError> {
        let path = socket(domain);
        let refused = |cause: std::io::Error| {
            LaunchError::Path(format!("{}: {cause}; is the disk full?", path.display()))
        };
        // A killed launcher's; the domain is locked, so it is nobody's.
        if path.exists() {
            std::fs::remove_file(&path).map_err(refused)?;
        }
        let listener = UnixListener::bind(&path).map_err(refused)?;
        let (sender, requests) = channel();
        std::thread::Builder::new()
            .name("control".to_owned())
            .spawn(move || {
                for stream in listener.incoming().flatten() {
                    receive(stream, &sender);
                    ringer.ring();
                }
            })
            .map_err(refused)?;
        Ok(Self { requests })
    }

    pub(crate) fn next(&self) -> Option<(Request, Reply)> {
        self.requests.try_recv().ok()
    }
}

fn receive(stream: UnixStream, sender: &Sender<(Request, Reply)>) {
    let mut reply = Reply { stream: None };
    let mut line = String::new();
    let read = stream.set_read_timeout(Some(PATIENCE)).and_then(|()| {
        reply.stream = Some(stream.try_clone()?);
        BufReader::new(stream.take(LONGEST_REQUEST)).read_line(&mut line)
    });
    match read.map_err(|cause| cause.to_string()).and_then(|_| {
        serde_json::from_str(&line).map_err(|cause| format!("not a request of this version of evac: {cause}"))
    }) {
        // Nobody listens any more where the launcher is on its way out.
        Ok(request) => drop(sender.send((request, reply))),
        Err(cause) => reply.fail(&cause),
    }
}

/// Whoever asked.
#[derive(Debug)]
pub(crate) struct Reply {
    stream: Option<UnixStream>,
}

impl Reply {
    pub(crate) fn progress(&mut self, text: &str) {
        self.send(&Answer::Progress(text.to_owned()));
    }

    pub(crate) fn done(&mut self, outcome: &Outcome) {
        self.send(&Answer::Done(outcome.clone()));
    }

    pub(crate) fn stages(&mut self, stages: Vec<StageWord>) {
        self.send(&Answer::Stages(stages));
    }

    pub(crate) fn fail(&mut self, cause: &str) {
        self.send(&Answer::Failed(cause.to_owned()));
    }

    /// Who does not listen any more misses nothing.
    fn send(&mut self, answer: &Answer) {
        let Ok(mut line) = serde_json::to_string(answer) else { return };
        line.push('\n');
        if self.stream.as_mut().is_some_and(|stream| stream.write_all(line.as_bytes()).is_err()) {
            self.stream = None;
        }
    }
}
