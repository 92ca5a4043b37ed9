//! Table and JSON of `evac experiment restarts`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use evac_formats::{FormatError, write_atomically};
use serde::Serialize;

/// A killed stage's pipeline is whole again within this time, milliseconds.
const LIMIT_MS: f64 = 1000.0;

/// One stage that was killed; times are from its end.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Restart {
    pub(super) stage: String,
    /// The last frame that it put out.
    pub(super) last_seq: Option<u64>,
    /// The first new one of the next instance.
    pub(super) next_seq: u64,
    /// The new process has reported itself.
    pub(super) up_ms: f64,
    /// The new frame was put out.
    pub(super) next_ms: f64,
    /// Every sink is done with the first scan after the death.
    pub(super) whole_ms: f64,
    /// Frames that both instances put out.
    pub(super) repeated: u64,
    /// First and last of the frames that nobody put out.
    pub(super) missing: Vec<(u64, u64)>,
}

/// All of a run.
#[derive(Debug, Default, Serialize)]
pub(super) struct Restarts {
    seed: u64,
    pub(super) kills: Vec<Restart>,
    /// Frames missing at a sink that the launcher did not state.
    pub(super) unstated: Vec<String>,
}

impl Restarts {
    pub(super) fn new(seed: u64) -> Self {
        Self { seed, ..Self::default() }
    }

    pub(super) fn table(&self) -> String {
        let mut text = format!(
            "{:<16} {:>10} {:>10} {:>10} {:>12} {:>12}  {}\n",
            "killed", "last frame", "process up", "next frame", "whole again", "put out twice", "missing"
        );
        // Writing to a String cannot fail.
        for kill in &self.kills {
            let last = kill.last_seq.map_or("-".to_owned(), |seq| seq.to_string());
            let gaps: Vec<_> = kill.missing.iter().map(|(first, last)| format!("{first}-{last}")).collect();
            let missing = if gaps.is_empty() { "none".to_owned() } else { gaps.join(", ") };
            let seconds = |ms: f64| format!("{:.2} s", ms * 1e-3);
            let _ = writeln!(
                text,
                "{:<16} {last:>10} {:>10} {:>10} {:>12} {:>12}  {missing}",
                kill.stage,
                seconds(kill.up_ms),
                seconds(kill.next_ms),
                seconds(kill.whole_ms),
                kill.repeated
            );
        }
        let worst = self.kills.iter().max_by(|a, b| a.whole_ms.total_cmp(&b.whole_ms));
        let verdict = |holds: bool| if holds { "held" } else { "NOT HELD" };
        if let Some(Restart { stage, whole_ms, .. }) = worst {
            let (holds, worst_s, limit_s) = (*whole_ms <= LIMIT_MS, whole_ms * 1e-3, LIMIT_MS * 1e-3);
            let _ = writeln!(
                text,
                "whole again within {limit_s} s, at worst {worst_s:.2} s ({stage}): {}",
                verdict(holds)
            );
        }
        let stated = self.unstated.is_empty();
        let _ = write!(text, "every frame that a sink misses is stated: {}", verdict(stated));
        for unstated in &self.unstated {
            let _ = write!(text, "\n{unstated}");
        }
        text
    }

    pub(super) fn write(&self, folder: &Path) -> Result<PathBuf, FormatError> {
        let path = folder.join("restarts.json");
        write_atomically(&path, |writer| {
            serde_json::to_writer_pretty(&mut *writer, self).map_err(std::io::Error::from)?;
            std::io::Write::write_all(writer, b"\n")
        })?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_line_a_kill_and_says_whether_the_slowest_keeps_to_the_limit() {
        let kill = |stage: &str, whole_ms: f64, missing: &[(u64, u64)]| Restart {
            stage: stage.to_owned(),
            last_seq: Some(80),
            next_seq: 81,
            up_ms: 120.0,
            next_ms: 210.0,
            whole_ms,
            repeated: 1,
            missing: missing.to_vec(),
        };
        let mut restarts = Restarts::new(1);
        restarts.kills = vec![kill("lio", 340.0, &[]), kill("map_saver", 990.0, &[(81, 82), (84, 84)])];
        let table = restarts.table();
        for words in [
            "0.12 s     0.21 s       0.34 s            1  none",
            "0.99 s            1  81-82, 84-84",
            "whole again within 1 s, at worst 0.99 s (map_saver): held",
            "misses is stated: held",
        ] {
            assert!(table.contains(words), "no '{words}' in\n{table}");
        }
        restarts.kills.push(kill("recorder", 1010.0, &[]));
        restarts.unstated = vec!["map_saver does not have frames 90 to 91 (2)".to_owned()];
        let table = restarts.table();
        assert!(table.contains("1.01 s (recorder): NOT HELD"), "{table}");
        assert!(table.contains("stated: NOT HELD\nmap_saver does not have frames 90"), "{table}");
    }
}
