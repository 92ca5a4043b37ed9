//! The whole pipeline of the simulator, under its launcher.
#![allow(dead_code)] // not every bench needs all of it

use std::path::Path;
use std::process::{Child, Command};

use anyhow::Context as _;
use evac_config::Pipeline;
use evac_ports::Domain;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use toml::Value as Toml;

/// What `evac up` runs with the simulator: live, in real time.
const PIPELINE: &str = include_str!("../../launch/pipelines/simulated.toml");
/// A lap takes seventy seconds: more than any bench stays.
const LAPS: i64 = 4;
pub(crate) const EVAC: &str = env!("CARGO_BIN_EXE_evac");

/// A pipeline under its launcher; dropping it stops all its processes.
pub(crate) struct Running {
    launcher: Child,
    domain: Domain,
    _folder: tempfile::TempDir,
}

impl Running {
    pub(crate) fn start(domain: Domain) -> anyhow::Result<Self> {
        let folder = tempfile::tempdir()?;
        let mut pipeline = Pipeline::parse(Path::new("simulated.toml"), PIPELINE)?;
        for stage in pipeline.stages.iter_mut().filter(|stage| stage.config.contains_key("output_dir")) {
            let output = folder.path().to_str().context("the folder for results has no UTF-8 name")?;
            stage.config.insert("output_dir".to_owned(), Toml::from(output));
        }
        for simulator in pipeline.stages.iter_mut().filter(|stage| stage.kind == "simulator") {
            simulator.config.insert("laps".to_owned(), Toml::from(LAPS));
        }
        let file = folder.path().join("pipeline.toml");
        std::fs::write(&file, toml::to_string(&pipeline)?)?;
        let launcher = Command::new(EVAC)
            .arg("up")
            .arg(&file)
            .args(["--domain", domain.name()])
            .spawn()
            .with_context(|| format!("{EVAC} cannot be started"))?;
        Ok(Self { launcher, domain, _folder: folder })
    }

    /// What `evac status --json` says about each stage.
    pub(crate) fn status(&self) -> anyhow::Result<Value> {
        let output =
            Command::new(EVAC).args(["status", "--json", "--domain", self.domain.name()]).output()?;
        anyhow::ensure!(output.status.success(), "evac status: {}", String::from_utf8_lossy(&output.stderr));
        let mut status: Value = serde_json::from_slice(&output.stdout)?;
        Ok(status["stages"].take())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(pid) = i32::try_from(self.launcher.id()).ok().and_then(Pid::from_raw) {
            // It may have ended by itself; either way it is reaped here.
            let _ = kill_process(pid, Signal::TERM);
        }
        let _ = self.launcher.wait();
    }
}
