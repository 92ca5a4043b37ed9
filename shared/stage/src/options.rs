//! Command line of a stage, the same for every stage and every language it is written in.

use std::path::PathBuf;

use clap::Args;
use evac_config::{Mode, Pipeline, Rig, StageEntry};
use evac_ports::Domain;

use crate::{LogOptions, RunError, StageConfig};

/// Command line of a stage.
#[derive(Debug, Clone, Args)]
pub struct RunOptions {
    /// Pipeline file with this stage's table, the rig and the mode [default: built-in defaults, live mode]
    #[arg(long, value_name = "PIPELINE.toml")]
    pub config: Option<PathBuf>,
    /// Name of this instance in the pipeline file [default: the stage's kind]
    #[arg(long)]
    pub name: Option<String>,
    /// Space of shared-memory services [default: the pipeline file's, or evac]
    #[arg(long)]
    pub domain: Option<String>,
    /// Number of this instance, written into every frame
    #[arg(long, default_value_t = 0)]
    pub epoch: u32,
    /// Follow the routed instance without publishing, until the launcher routes this one
    #[arg(long)]
    pub standby: bool,
    /// Follow the routed instance to where it is, then go on beside it; the output goes to the domain's shadows
    #[arg(long, conflicts_with = "standby")]
    pub shadow: bool,
    /// Print the configuration that would be used, with every default, and end
    #[arg(long)]
    pub print_config: bool,
    /// Check the configuration and end
    #[arg(long)]
    pub check: bool,
    /// End when the process PID, which has started this one, ends
    #[arg(long, value_name = "PID")]
    pub die_with_parent: Option<u32>,
    /// Logging.
    #[command(flatten)]
    pub log: LogOptions,
}

/// What a run knows after its command line and pipeline file are read.
#[derive(Debug, Clone)]
pub(crate) struct Context {
    pub(crate) name: String,
    pub(crate) domain: Domain,
    pub(crate) epoch: u32,
    pub(crate) mode: Mode,
    pub(crate) rate: Option<f64>,
    pub(crate) step: bool,
    pub(crate) rig: Rig,
    pub(crate) pipeline: Option<Pipeline>,
    entry: StageEntry,
}

impl RunOptions {
    pub(crate) fn context(&self, kind: &str) -> Result<Context, RunError> {
        let name = self.name.clone().unwrap_or_else(|| kind.to_owned());
        let pipeline = self.config.as_deref().map(Pipeline::read).transpose()?;
        let entry = match &pipeline {
            None => StageEntry::of_kind(kind),
            Some(pipeline) => pipeline.stage(&name).cloned().ok_or_else(|| {
                let names: Vec<_> = pipeline.stages.iter().map(StageEntry::name).collect();
                RunError::Value(format!(
                    "the pipeline file has no stage named '{name}' (it has: {}); choose one with --name",
                    names.join(", ")
                ))
            })?,
        };
        let domain = self.domain.as_deref().or(pipeline.as_ref().and_then(|p| p.domain.as_deref()));
        Ok(Context {
            name,
            domain: Domain::new(domain.unwrap_or(Domain::DEFAULT))?,
            epoch: self.epoch,
            mode: pipeline.as_ref().map_or(Mode::Live, |p| p.mode),
            rate: pipeline.as_ref().and_then(|p| p.rate),
            step: pipeline.as_ref().is_some_and(|p| p.step),
            rig: pipeline.as_ref().map_or_else(Rig::default, |p| p.rig),
            pipeline,
            entry,
        })
    }
}

impl Context {
    pub(crate) fn config<C: StageConfig>(&self) -> Result<C, RunError> {
        let config: C = self.entry.typed_config().map_err(RunError::Value)?;
        config.check().map_err(|cause| RunError::Value(format!("stage '{}': {cause}", self.name)))?;
        Ok(config)
    }

    /// The whole pipeline file; empty where there is none.
    pub(crate) fn pipeline_text(&self) -> Result<String, RunError> {
        self.pipeline
            .as_ref()
            .map_or(Ok(String::new()), |pipeline| toml::to_string(pipeline).map_err(unprintable))
    }

    /// A pipeline file with this stage alone and its whole configuration.
    pub(crate) fn with_config<C: StageConfig>(&self, config: &C) -> Result<String, RunError> {
        let config = toml::Table::try_from(config).map_err(unprintable)?;
        let stages = vec![StageEntry { config, ..self.entry.clone() }];
        let (mode, rate, step, rig) = (self.mode, self.rate, self.step, self.rig);
        let supervision = evac_config::Supervision::default();
        let pipeline = Pipeline { domain: None, mode, rate, step, rig, supervision, stages };
        toml::to_string(&pipeline).map_err(unprintable)
    }

    /// Whether a stage of the pipeline is of one of these kinds.
    pub(crate) fn has_kind(&self, kinds: &[&str]) -> bool {
        self.pipeline
            .as_ref()
            .is_some_and(|p| p.stages.iter().any(|stage| kinds.contains(&stage.kind.as_str())))
    }
}

fn unprintable(cause: toml::ser::Error) -> RunError {
    RunError::Value(format!("the configuration cannot be printed: {cause}"))
}
