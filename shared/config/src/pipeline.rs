//! A pipeline file: which stages run, on which rig, and how the stream is paced.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::{ConfigError, Rig, Scheduling, Supervision};

/// Letters of a stage's name: what a health frame has room for, with its final zero.
const LONGEST_NAME: usize = 23;

/// How frames flow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// In real time; a stage that falls behind loses frames, which are counted.
    #[default]
    Live,
    /// As fast as the slowest stage, nothing lost, the same result every time. Only for recordings and the simulator.
    Lossless,
}

/// A whole pipeline file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pipeline {
    /// Domain on this machine; `--domain` overrides it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub domain: Option<String>,
    /// How frames flow.
    #[serde(default)]
    pub mode: Mode,
    /// Speed of a recording or the simulator: 1 is real time, 2 twice as fast. Where it is absent, a live stream runs
    /// in real time and a lossless one as fast as its sinks; where it is given, a lossless one runs no faster than it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// A recording or the simulator waits before each scan for a line on standard input.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub step: bool,
    /// Where the sensors sit.
    #[serde(default)]
    pub rig: Rig,
    /// What counts as a hang, and where journals are.
    #[serde(default, skip_serializing_if = "Supervision::is_default")]
    pub supervision: Supervision,
    /// The stages.
    #[serde(default, rename = "stage")]
    pub stages: Vec<StageEntry>,
}

/// One `[[stage]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageEntry {
    /// What it is, for example `deskewer` or `lio`; fixes the services it reads and writes.
    pub kind: String,
    /// Name of this instance; the kind where it is absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Another executable that keeps the contract, with its first arguments; evac's own where it is absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<Vec<PathBuf>>,
    /// How the kernel schedules it; as any process where it is absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scheduling: Option<Scheduling>,
    /// Its configuration.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub config: toml::Table,
}

impl StageEntry {
    /// A stage of evac's own with default configuration.
    pub fn of_kind(kind: &str) -> Self {
        Self { kind: kind.to_owned(), name: None, run: None, scheduling: None, config: toml::Table::new() }
    }

    /// Name of this instance.
    pub fn name(&self) -> &str {
        self.name.as_deref().unwrap_or(&self.kind)
    }

    /// Its configuration in the stage's own type.
    ///
    /// # Errors
    /// One sentence naming the stage, the key and what is allowed.
    pub fn typed_config<C: serde::de::DeserializeOwned>(&self) -> Result<C, String> {
        let config: Result<C, _> = self.config.clone().try_into();
        config.map_err(|cause| {
            format!("stage '{}': {}", self.name(), cause.to_string().trim().replace('\n', " "))
        })
    }
}

impl Pipeline {
    /// Reads a pipeline file.
    ///
    /// # Errors
    /// [`ConfigError`] with the place in the file.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        Self::parse(path, &ConfigError::read(path)?)
    }

    /// Parses the text of a pipeline file; `path` is only for messages.
    ///
    /// # Errors
    /// [`ConfigError`] with the place in the file.
    pub fn parse(path: &Path, text: &str) -> Result<Self, ConfigError> {
        let pipeline: Self = toml::from_str(text).map_err(|cause| ConfigError::toml(path, text, &cause))?;
        pipeline.check().map_err(|cause| ConfigError::value(path, cause))?;
        Ok(pipeline)
    }

    /// The stage of that name.
    pub fn stage(&self, name: &str) -> Option<&StageEntry> {
        self.stages.iter().find(|stage| stage.name() == name)
    }

    fn check(&self) -> Result<(), String> {
        if let Some(rate) = self.rate
            && !(rate.is_finite() && rate > 0.0 && rate <= 1000.0)
        {
            return Err(format!("rate = {rate} must be above 0 and at most 1000"));
        }
        self.rig.check()?;
        self.supervision.check()?;
        for (i, stage) in self.stages.iter().enumerate() {
            let name = stage.name();
            if name.is_empty()
                || name.len() > LONGEST_NAME
                || !name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c))
            {
                return Err(format!(
                    "stage name '{name}' must be 1 to {LONGEST_NAME} letters, digits, '-' or '_'"
                ));
            }
            if self.stages.iter().take(i).any(|other| other.name() == name) {
                return Err(format!(
                    "two stages are named '{name}'; give one of them another name = \"...\""
                ));
            }
            if stage.run.as_ref().is_some_and(Vec::is_empty) {
                return Err(format!("stage '{name}': run = [] names no executable"));
            }
            if let Some(scheduling) = &stage.scheduling {
                scheduling.check().map_err(|cause| format!("stage '{name}': {cause}"))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Pipeline, ConfigError> {
        Pipeline::parse(Path::new("p.toml"), text)
    }

    #[test]
    fn a_pipeline_file_survives_a_round_trip() {
        let text = "mode = \"lossless\"\n[rig.imu_from_lidar]\ntranslation_m = [0.1, 0.0, 0.0]\n\
                    [[stage]]\nkind = \"lio\"\nname = \"odometry\"\nrun = [\"./mine\"]\n[stage.config]\na = 1\n";
        let pipeline = parse(text).unwrap();
        assert_eq!(pipeline.stage("odometry").unwrap().kind, "lio");
        assert_eq!(pipeline.rig.imu_from_lidar.translation_m, [0.1, 0.0, 0.0]);
        assert_eq!(parse(&toml::to_string(&pipeline).unwrap()).unwrap(), pipeline);
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_line() {
        let error = parse("mode = \"live\"\nspeed = 2\n").unwrap_err().to_string();
        assert!(error.contains("p.toml") && error.contains("line 2") && error.contains("speed"), "{error}");
    }

    #[test]
    fn nonsense_is_refused_with_a_reason() {
        for (text, word) in [
            ("rate = -1.0", "rate"),
            ("[[stage]]\nkind = \"lio\"\n[[stage]]\nkind = \"lio\"", "two stages"),
            ("[[stage]]\nkind = \"a b\"", "letters"),
            ("[[stage]]\nkind = \"lio\"\nrun = []", "executable"),
            ("[rig.imu_from_lidar]\ntranslation_m = [nan, 0.0, 0.0]", "finite"),
            ("[supervision]\nhang_after_frames = 1", "hang_after_frames"),
            ("[supervision]\njournal_max_mib = nan", "journal_max_mib"),
            ("[[stage]]\nkind = \"lio\"\n[stage.scheduling]\nfifo_priority = 100", "fifo_priority"),
            ("[[stage]]\nkind = \"lio\"\n[stage.scheduling]\ncpus = [0, 5000]", "5000"),
            ("[rig.imu_from_lidar]\nroll_pitch_yaw_deg = [0.0, 0.0, 400.0]", "360"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
