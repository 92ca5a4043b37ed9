//! `evac doctor`: what would stop a run, or spoil it, on this machine, and what to do about it.

mod clock;
mod finding;
mod imu;
mod lidar;
mod memory;
mod processor;
mod search;
mod serial;
mod wire;

use std::path::{Path, PathBuf};

use clap::Args;
use evac_config::Pipeline;
use serde_json::json;

use crate::check;
use crate::error::LaunchError;
use finding::{Finding, Grade};

#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// Pipeline file whose devices are looked at too
    #[arg(value_name = "PIPELINE.toml")]
    pipeline: Option<PathBuf>,
    /// Serial port to listen at for an IMU
    #[arg(long, value_name = "PORT", conflicts_with = "pipeline")]
    imu: Option<PathBuf>,
    /// Remove what dead pipelines left in shared memory
    #[arg(long)]
    clean: bool,
    /// Look at (and clean) what was left in this domain only
    #[arg(long)]
    domain: Option<String>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// `evac doctor [PIPELINE.toml]`.
pub(crate) fn doctor(args: &DoctorArgs) -> Result<(), LaunchError> {
    let root = Path::new("/");
    let mut findings = memory::leftovers(args.clean, args.domain.as_deref());
    findings.push(memory::room());
    findings.extend(clock::look(root));
    findings.push(processor::look(root));
    findings.extend(serial::look(root));
    match &args.pipeline {
        Some(path) => findings.extend(of_pipeline(path, root)),
        None => findings.push(lidar::buffers(root, None)),
    }
    if let Some(port) = &args.imu {
        let config = evac_imu::Config { port: port.clone(), ..evac_imu::Config::default() };
        findings.extend(imu::look("imu", config));
    }
    let faults = findings.iter().filter(|finding| finding.grade == Grade::Fault).count();
    if args.json {
        let rows: Vec<_> = findings.iter().map(Finding::as_json).collect();
        println!("{:#}", json!({ "can_run": faults == 0, "findings": rows }));
    } else {
        for finding in &findings {
            println!("{finding}");
        }
    }
    if faults > 0 { Err(LaunchError::Unfit(faults)) } else { Ok(()) }
}

/// The file itself, and the devices that it names.
fn of_pipeline(path: &Path, root: &Path) -> Vec<Finding> {
    const TOPIC: &str = "pipeline";
    let text = || path.display().to_string();
    let pipeline = match check::read_checked(path) {
        Ok(pipeline) => pipeline,
        Err(error) => {
            let remedy = "correct the file, then look again";
            return vec![Finding::fault(TOPIC, error.to_string(), remedy)];
        }
    };
    let mut findings = vec![Finding::good(TOPIC, format!("{} is valid", text()))];
    findings.extend(running(&pipeline));
    for entry in pipeline.stages.iter().filter(|entry| entry.run.is_none()) {
        match entry.kind.as_str() {
            "imu" => match entry.typed_config() {
                Ok(config) => findings.extend(imu::look(entry.name(), config)),
                Err(cause) => findings.push(Finding::fault(TOPIC, cause, "correct the file")),
            },
            "lidar" => findings.extend(lidar::look(root, entry)),
            _ => {}
        }
    }
    findings
}

/// Whether the file's domain is taken: then its devices are too.
fn running(pipeline: &Pipeline) -> Option<Finding> {
    let name = pipeline.domain.as_deref().unwrap_or(evac_ports::Domain::DEFAULT);
    let holder = evac_ports::Domain::new(name).ok()?.holder()?;
    let text = format!("a pipeline runs in domain '{name}' already, started by process {holder}");
    Some(Finding::fault("pipeline", text, "`evac down`, or another domain"))
}
