//! `evac check`: what can be wrong is found before anything starts.

use std::path::Path;

use evac_config::{ConfigError, Pipeline};

use crate::error::LaunchError;
use crate::registry::{Kind, SOURCES, kind};

/// Services that a stage can do without.
const OPTIONAL: &[&str] = &["odometry/pose", "truth/pose", "map/snapshot"];
/// The kind that listens to whatever there is.
const LISTENER: &str = "recorder";

/// `evac check PIPELINE.toml`.
pub(crate) fn check_file(path: &Path) -> Result<(), LaunchError> {
    let pipeline = read_checked(path)?;
    println!("{}: valid, {} stages", path.display(), pipeline.stages.len());
    for stage in &pipeline.stages {
        let Kind { reads, writes_as, .. } = kind(&stage.kind)?;
        let writes = writes_as(stage);
        println!("  {:<16} {:<14} {} -> {}", stage.name(), stage.kind, reads.join(" "), writes.join(" "));
    }
    Ok(())
}

/// Reads a pipeline file and checks everything that can be checked before it runs.
pub(crate) fn read_checked(path: &Path) -> Result<Pipeline, LaunchError> {
    let pipeline = Pipeline::read(path)?;
    check(&pipeline).map_err(|cause| ConfigError::value(path, cause))?;
    Ok(pipeline)
}

/// Kinds, configurations, executables, and that every service has exactly one writer and every reader one to read from.
pub(crate) fn check(pipeline: &Pipeline) -> Result<(), String> {
    if pipeline.stages.is_empty() {
        return Err("there is no [[stage]]; start from a file in launch/pipelines".to_owned());
    }
    if pipeline.step && !pipeline.stages.iter().any(|stage| SOURCES.contains(&stage.kind.as_str())) {
        return Err(format!(
            "step = true needs a stage of kind {}; sensors do not wait",
            SOURCES.join(" or ")
        ));
    }
    let mut kinds = Vec::new();
    for entry in &pipeline.stages {
        let kind = kind(&entry.kind).map_err(|error| error.to_string())?;
        // Another executable has a configuration of its own, which only it can check.
        match entry.run.as_deref().and_then(<[_]>::first) {
            None => (kind.check)(entry)?,
            Some(executable) => check_executable(entry.name(), executable)?,
        }
        kinds.push((entry.name(), (kind.writes_as)(entry), kind));
    }
    for (name, _, reader) in kinds.iter().filter(|(_, _, kind)| kind.name != LISTENER) {
        for service in reader.reads {
            let has_writer = kinds.iter().any(|(_, writes, _)| writes.contains(service));
            if !has_writer && !OPTIONAL.contains(service) {
                let remedy = match *service {
                    "imu/sample" => "add a stage imu, or publish_imu = true to a lidar that has an IMU",
                    _ => "add one that does",
                };
                return Err(format!("stage '{name}' reads {service}, which no stage writes; {remedy}"));
            }
        }
    }
    for (i, (name, writes, _)) in kinds.iter().enumerate() {
        for (other, second, _) in kinds.iter().skip(i + 1) {
            if let Some(service) = writes.iter().find(|service| second.contains(service)) {
                return Err(format!(
                    "stages '{name}' and '{other}' both write {service}; remove one of them"
                ));
            }
        }
    }
    Ok(())
}

fn check_executable(name: &str, executable: &Path) -> Result<(), String> {
    use std::os::unix::fs::PermissionsExt as _;
    // A bare name is looked up in PATH when it is started.
    if executable.components().count() == 1 {
        return Ok(());
    }
    match std::fs::metadata(executable) {
        Ok(file) if file.is_file() && file.permissions().mode() & 0o111 != 0 => Ok(()),
        Ok(_) => {
            Err(format!("stage '{name}': {} is not an executable file (chmod +x?)", executable.display()))
        }
        Err(cause) => {
            Err(format!("stage '{name}': {}: {cause}; check the path in run", executable.display()))
        }
    }
}
