//! Requests to a running launcher: JSON lines over a socket in the domain's folder, which only its user may enter.

mod client;
mod server;
mod stages;

use std::path::PathBuf;

use evac_ports::Domain;
use serde::{Deserialize, Serialize};

pub(crate) use client::{ask, promote, shadow, standby, swap};
pub(crate) use server::{Reply, Server};
pub(crate) use stages::{StageWord, stages};

/// What a launcher can be asked for, one line.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Request {
    pub(crate) order: Order,
    /// Name of the stage in the pipeline file.
    pub(crate) stage: String,
    /// Another kind of stage that writes the same services.
    pub(crate) kind: Option<String>,
    /// Another executable that keeps the contract, with its first arguments.
    pub(crate) run: Option<Vec<PathBuf>>,
    /// Pipeline file with the new instance's configuration.
    pub(crate) config: Option<PathBuf>,
    /// Longest time until the new instance is ready, seconds.
    pub(crate) patience_s: f64,
}

/// What to do with the new instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Order {
    /// It takes over when it is ready.
    Swap,
    /// It follows, and takes over when the routed one dies.
    Standby,
    /// It goes on beside the routed one, unheard.
    Shadow,
    /// The stage's shadow is ended.
    Unshadow,
    /// What runs as the stage's shadow takes over.
    Promote,
    /// Nothing: the launcher says what it knows of all stages.
    Stages,
}

/// What a launcher answers, each a line; the last is `Done` or `Failed`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Answer {
    /// How far it is.
    Progress(String),
    Done(Outcome),
    /// To `Order::Stages`.
    Stages(Vec<StageWord>),
    /// Nothing has changed, and why.
    Failed(String),
}

/// What a request came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub(crate) stage: String,
    pub(crate) kind: String,
    pub(crate) pid: u32,
    /// The instance that leads or stands by now.
    pub(crate) epoch: u32,
    /// Its first frame, where it leads.
    pub(crate) from_seq: Option<u64>,
    /// From its start until it could take over, seconds.
    pub(crate) ready_s: f64,
    /// From the word to the old one to that of the new one that it leads, milliseconds.
    pub(crate) handover_ms: Option<f64>,
}

fn socket(domain: &Domain) -> PathBuf {
    domain.folder().join("control.sock")
}
