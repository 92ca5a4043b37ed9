//! Runs `octomap.cpp` and reads what it prints.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};

use crate::Case;

/// Empty where it could not be built.
const PROGRAM: &str = env!("OCTOMAP_PROGRAM");

/// The figures that it printed, in their order.
pub(crate) struct Figures(Vec<(String, f64)>);

impl Figures {
    fn parse(text: &str) -> anyhow::Result<Self> {
        let mut figures = Vec::new();
        for line in text.lines() {
            let (key, value) = line.split_once(' ').with_context(|| format!("no figure: {line}"))?;
            figures.push((key.to_owned(), value.parse().with_context(|| format!("no number: {line}"))?));
        }
        Ok(Self(figures))
    }

    pub(crate) fn all(&self, key: &str) -> Vec<f64> {
        self.0.iter().filter(|(name, _)| name == key).map(|(_, value)| *value).collect()
    }

    pub(crate) fn last(&self, key: &str) -> Option<f64> {
        self.all(key).last().copied()
    }
}

pub(crate) fn is_built() -> bool {
    !PROGRAM.is_empty()
}

/// Inserts the scans of a file; `folder` gets the maps and the figures. What an earlier run has left there is taken as it
/// is.
pub(crate) fn run(case: &Case, scans: &Path, folder: &Path) -> anyhow::Result<Figures> {
    let kept = folder.join("figures");
    if let Ok(text) = fs::read_to_string(&kept) {
        println!("OctoMap's figures are of the run that has left {}", kept.display());
        return Figures::parse(&text);
    }
    fs::create_dir_all(folder)?;
    let output = Command::new(PROGRAM)
        .arg(scans)
        .args([case.resolution.to_string(), case.max_range.to_string()])
        .arg(if case.discretized { "discretized" } else { "exact" })
        .arg(if case.queries() { "queries" } else { "none" })
        .arg(folder)
        .args(case.checkpoints.iter().map(ToString::to_string))
        .stderr(Stdio::inherit())
        .output()
        .context("the program that links OctoMap did not start")?;
    if !output.status.success() {
        bail!("the program that links OctoMap ended with {}", output.status);
    }
    let text = String::from_utf8_lossy(&output.stdout);
    fs::write(kept, text.as_bytes())?;
    Figures::parse(&text)
}
