//! What the launcher knows of every stage: who leads, who else lives, what was started again.

use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use evac_frames::Route;
use evac_ports::Domain;
use serde::{Deserialize, Serialize};

use super::{Answer, Order, Request, socket};
use crate::registry::{Role, kind};
use crate::supervisor::Supervisor;

/// A launcher that writes its last files does not answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// One stage, in the pipeline's order.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StageWord {
    pub(crate) name: String,
    pub(crate) kind: String,
    /// `producer`, `processor` or `consumer`.
    pub(crate) role: String,
    /// The data service that it writes, if any.
    pub(crate) writes: Option<String>,
    /// The instance that is routed.
    pub(crate) epoch: u32,
    /// The first frame from which it is; absent while nobody else ever was.
    pub(crate) from_seq: Option<u64>,
    /// Times that the stage was started again after a crash.
    pub(crate) restarts: u64,
    /// All that live, the routed one included.
    pub(crate) instances: Vec<Instance>,
}

/// A process of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Instance {
    pub(crate) epoch: u32,
    pub(crate) pid: u32,
}

impl Supervisor {
    pub(crate) fn stage_words(&self) -> Vec<StageWord> {
        self.slots
            .iter()
            .map(|slot| {
                let alive = self.children.iter().filter(|child| child.name == slot.name());
                let alive = alive.filter(|child| child.ended.is_none());
                let writes = kind(&slot.entry.kind).ok().and_then(|kind| kind.writes.first().copied());
                let role = match slot.role {
                    Role::Producer => "producer",
                    Role::Processor => "processor",
                    Role::Consumer => "consumer",
                };
                StageWord {
                    name: slot.name().to_owned(),
                    kind: slot.entry.kind.clone(),
                    role: role.to_owned(),
                    writes: writes.map(str::to_owned),
                    epoch: slot.epoch,
                    from_seq: slot.route.map(|Route { from_seq, .. }| from_seq),
                    restarts: slot.restarts,
                    instances: alive.map(|child| Instance { epoch: child.epoch, pid: child.pid() }).collect(),
                }
            })
            .collect()
    }
}

/// Asks the domain's launcher; nothing where it does not answer: it is about to end, or of another version.
pub(crate) fn stages(domain: &Domain) -> Vec<StageWord> {
    let ask = || -> std::io::Result<Vec<StageWord>> {
        let stream = UnixStream::connect(socket(domain))?;
        stream.set_read_timeout(Some(PATIENCE))?;
        let request = Request {
            order: Order::Stages,
            stage: String::new(),
            kind: None,
            run: None,
            config: None,
            patience_s: 0.0,
        };
        (&stream).write_all(format!("{}\n", serde_json::to_string(&request)?).as_bytes())?;
        let mut line = String::new();
        BufReader::new(stream).read_line(&mut line)?;
        match serde_json::from_str(&line)? {
            Answer::Stages(stages) => Ok(stages),
            _ => Ok(Vec::new()),
        }
    };
    ask().unwrap_or_default()
}
