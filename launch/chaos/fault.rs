//! Which fault comes next: drawn from a seed, so that a run can be repeated.

use std::time::{Duration, Instant};

use serde::Serialize;

/// What is done to a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Deed {
    /// kill -9.
    Kill,
    /// SIGSTOP until it is taken for hung.
    Freeze,
    /// SIGSTOP for up to a second and a half.
    Pause,
    /// SIGSTOP and SIGCONT in turn for two seconds: a stage that is slow.
    Slow,
    /// Another instance takes its place; an odometry becomes the other kind.
    Swap,
    /// A standby, and kill -9 of the one that leads.
    KillBesideStandby,
    /// A shadow, compared with the one that leads, and then promoted or ended; an odometry's is of the other kind.
    Shadow,
}

impl Deed {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Kill => "kill -9",
            Self::Freeze => "SIGSTOP",
            Self::Pause => "pause",
            Self::Slow => "slow",
            Self::Swap => "swap",
            Self::KillBesideStandby => "kill -9 + standby",
            Self::Shadow => "shadow",
        }
    }

    /// Whether the launcher starts the stage again, for which it has a budget.
    fn restarts(self) -> bool {
        matches!(self, Self::Kill | Self::Freeze)
    }
}

const DEEDS: [Deed; 7] =
    [Deed::Kill, Deed::Freeze, Deed::Pause, Deed::Slow, Deed::Swap, Deed::KillBesideStandby, Deed::Shadow];
/// As they are in the pipeline file.
pub(super) const STAGES: [&str; 6] =
    ["simulator", "deskewer", "lio", "octree_mapper", "grid_exporter", "map_saver"];
/// The launcher puts up with three crashes a minute of a stage; one less is asked of it.
const BUDGET: (usize, Duration) = (2, Duration::from_secs(65));

/// Draws faults.
#[derive(Debug)]
pub(super) struct Dice {
    state: u64,
    restarts: Vec<(&'static str, Instant)>,
}

impl Dice {
    pub(super) fn new(seed: u64) -> Self {
        Self { state: seed, restarts: Vec::new() }
    }

    /// A whole number below `count` (SplitMix64).
    pub(super) fn below(&mut self, count: u64) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % count.max(1)
    }

    /// The next stage and what is done to it.
    pub(super) fn draw(&mut self) -> (&'static str, Deed) {
        self.restarts.retain(|(_, when)| when.elapsed() < BUDGET.1);
        loop {
            let stage = STAGES.get(self.below(STAGES.len() as u64) as usize).copied().unwrap_or("lio");
            let deed = DEEDS.get(self.below(DEEDS.len() as u64) as usize).copied().unwrap_or(Deed::Kill);
            let fits = match stage {
                // A producer that is stopped stops everything by itself, and of two only one has the sensor.
                "simulator" => matches!(deed, Deed::Kill | Deed::Swap),
                // Two of them would write the same files.
                "grid_exporter" | "map_saver" => deed != Deed::Shadow,
                _ => true,
            };
            let lately = self.restarts.iter().filter(|(other, _)| *other == stage).count();
            if fits && (!deed.restarts() || lately < BUDGET.0) {
                if deed.restarts() {
                    self.restarts.push((stage, Instant::now()));
                }
                return (stage, deed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_faults_and_no_stage_is_killed_beyond_the_launcher_s_budget() {
        let draw = |seed| {
            let mut dice = Dice::new(seed);
            (0..60).map(|_| dice.draw()).collect::<Vec<_>>()
        };
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7), draw(8));
        for stage in STAGES {
            let kills = draw(7).into_iter().filter(|(of, deed)| *of == stage && deed.restarts()).count();
            assert!(kills <= BUDGET.0, "{stage}: {kills}");
        }
    }
}
