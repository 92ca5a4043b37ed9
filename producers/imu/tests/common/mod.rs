//! A driver and a module on a pseudo-terminal.

#![allow(dead_code, clippy::unwrap_used, reason = "each test uses a part of this")]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use evac_frames::ImuSample;
use evac_imu::{Config, Imu};
use evac_simulator::devices::wt901c::{Bench, Line, Module};
use evac_stage::{Device as _, ImuOutput, Reporter, Rig};
use tempfile::TempDir;

/// Longer than anything here takes.
const WATCHDOG: Duration = Duration::from_secs(60);

/// Of one call: a read that waits in vain makes an error, which is allocated.
const PATIENCE: Duration = Duration::from_millis(500);

/// One g in raw words.
pub(crate) const ONE_G: i16 = 2048;

/// A driver with what it has published and said.
pub(crate) struct Driver {
    imu: Imu,
    pub(crate) output: ImuOutput,
    pub(crate) reporter: Reporter,
}

impl Driver {
    pub(crate) fn new(config: Config) -> Self {
        Self {
            imu: Imu::new(config, &Rig::default()).unwrap(),
            output: ImuOutput::default(),
            reporter: Reporter::detached(),
        }
    }

    pub(crate) fn serve(&mut self) {
        self.imu.serve(&mut self.output, &mut self.reporter, PATIENCE).unwrap();
    }

    /// Runs until `done`.
    pub(crate) fn run_until(&mut self, what: &str, mut done: impl FnMut(&Self) -> bool) {
        let until = Instant::now() + WATCHDOG;
        while !done(self) {
            assert!(Instant::now() < until, "never: {what}; the driver says '{}'", self.reporter.noted());
            self.serve();
        }
    }

    /// Runs until so many more samples have come; gives them.
    pub(crate) fn take(&mut self, count: usize) -> Vec<ImuSample> {
        let from = self.output.memory.len();
        self.run_until("samples", |driver| driver.output.memory.len() >= from + count);
        self.output.memory[from..].to_vec()
    }

    /// Runs until the note contains `words`.
    pub(crate) fn run_until_noted(&mut self, words: &str) {
        self.run_until(words, |driver| driver.reporter.noted().contains(words));
    }
}

/// A folder for the link, and its path.
pub(crate) fn link() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("evac-imu");
    (folder, path)
}

/// A module at rest on a table, its gyroscope a little off zero.
pub(crate) fn at_rest(number: u64) -> ([i16; 3], [i16; 3]) {
    let noise = (number % 7) as i16 - 3;
    ([noise, -noise, ONE_G + noise], [noise, 2, -noise])
}

/// A module with settings as they leave the factory, at rest.
pub(crate) fn factory(link: &std::path::Path) -> Bench {
    Bench::start(link, Module::new(Line::Serial), at_rest).unwrap()
}

pub(crate) fn config(link: &std::path::Path) -> Config {
    Config { port: link.to_owned(), ..Config::default() }
}

/// Differences of neighbouring stamps, milliseconds.
pub(crate) fn periods_ms(samples: &[ImuSample]) -> Vec<f64> {
    samples.windows(2).map(|pair| (pair[1].stamp_ns - pair[0].stamp_ns) as f64 * 1e-6).collect()
}
