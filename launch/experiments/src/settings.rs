//! What is run, and how it is configured.

use evac_deskewer::DeskewerConfig;
use evac_odometry::{LioConfig, LoamConfig};
use evac_stage::StageConfig;
use toml::{Table, Value};

use crate::ExperimentError;

/// Which odometry is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OdometryKind {
    /// The tightly coupled filter.
    #[default]
    Lio,
    /// The paper's method; without the deskewer it uses no IMU.
    Loam,
}

/// What is run and how it is configured.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// The odometry.
    pub odometry: OdometryKind,
    /// Configuration of the deskewer; `enabled = false` leaves the motion in the scans.
    pub deskewer: DeskewerConfig,
    /// Configuration of `lio`.
    pub lio: LioConfig,
    /// Configuration of `loam`.
    pub loam: LoamConfig,
}

impl Settings {
    /// Changes one key: `lio.range_noise_m=0.03`; the value is written as in a pipeline file.
    ///
    /// # Errors
    /// [`ExperimentError::Option`] naming what is wrong with it and what to try.
    pub fn set(&mut self, assignment: &str) -> Result<(), ExperimentError> {
        let wrong = |cause: String| ExperimentError::Option(format!("--set {assignment}: {cause}"));
        let parts = assignment.split_once('=').and_then(|(name, value)| Some((name.split_once('.')?, value)));
        let Some(((stage, key), value)) = parts else {
            return Err(wrong("write STAGE.KEY=VALUE, for example lio.range_noise_m=0.03".to_owned()));
        };
        let parsed: Table =
            toml::from_str(&format!("value = {value}")).map_err(|cause| wrong(cause.message().to_owned()))?;
        let value = parsed.get("value").cloned().unwrap_or(Value::Boolean(false));
        match stage.trim() {
            "lio" => self.lio = changed(&self.lio, key.trim(), value).map_err(wrong)?,
            "loam" => self.loam = changed(&self.loam, key.trim(), value).map_err(wrong)?,
            "deskewer" => self.deskewer = changed(&self.deskewer, key.trim(), value).map_err(wrong)?,
            other => {
                return Err(wrong(format!(
                    "there is no stage '{other}' here; the stages are lio, loam, deskewer"
                )));
            }
        }
        Ok(())
    }
}

fn changed<C: StageConfig>(config: &C, key: &str, value: Value) -> Result<C, String> {
    let mut table = Table::try_from(config).map_err(|cause| cause.to_string())?;
    // A key that takes fractions may be given a whole number.
    let value = match (table.get(key), value) {
        (Some(Value::Float(_)), Value::Integer(whole)) => Value::Float(whole as f64),
        (_, value) => value,
    };
    table.insert(key.to_owned(), value);
    let config: C = table.try_into().map_err(|cause: toml::de::Error| cause.message().to_owned())?;
    config.check()?;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_key_is_changed_and_the_others_stay() {
        let mut settings = Settings::default();
        settings.set("lio.accel_noise_m_s2=0.09").unwrap();
        settings.set("lio.max_speed_m_s = 4").unwrap();
        let expected = LioConfig { accel_noise_m_s2: 0.09, max_speed_m_s: 4.0, ..LioConfig::default() };
        assert_eq!(settings.lio, expected);
    }

    #[test]
    fn a_wrong_stage_key_value_or_form_is_named() {
        for (assignment, word) in [
            ("lio.no_such_key=1", "no_such_key"),
            ("lio.range_noise_m=-1", "range_noise_m"),
            ("mapper.resolution_m=1", "the stages are"),
            ("range_noise_m", "STAGE.KEY=VALUE"),
            ("lio.range_noise_m=much", "lio.range_noise_m=much"),
        ] {
            let error = Settings::default().set(assignment).unwrap_err().to_string();
            assert!(error.contains(word), "{assignment}: {error}");
        }
    }
}
