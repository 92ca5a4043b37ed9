//! How good the trajectories of faultless walks are.

use super::{Acceptance, Report, Run, Table, median, worst};
use crate::{Fault, Group};

/// What the device itself does to its gyroscope may cost so much more.
const AUTO_ZERO_FACTOR: f64 = 1.5;

/// One row a run without a fault or with the WT901C's automatic zeroing, and the limits of accuracy.
pub fn accuracy(runs: &[Run]) -> Report {
    let mut table = Table::new(&[
        "walk",
        "path m",
        "APE m",
        "max m",
        "RPE 1 m",
        "end m",
        "end %",
        "end deg",
        "z std m",
        "degenerate",
        "3 sigma",
        "ms",
        "p99 ms",
    ]);
    for run in runs {
        let figures = &run.figures;
        let fault = if run.fault == Fault::None { String::new() } else { format!(", {}", run.fault.name()) };
        table.row([
            format!("{}{fault}", run.walk),
            format!("{:.1}", figures.path_m),
            format!("{:.4}", figures.ape_m),
            format!("{:.4}", figures.ape_max_m),
            format!("{:.4}", figures.rpe_1m),
            format!("{:.4}", figures.drift_m),
            format!("{:.3}", figures.drift_percent),
            format!("{:.3}", figures.rotation_deg),
            format!("{:.4}", figures.z_std_m),
            format!("{} of {}", figures.degenerate, figures.frames),
            format!("{:.1} %", 100.0 * figures.within_3_sigma),
            format!("{:.2}", figures.median_ms),
            format!("{:.2}", figures.p99_ms),
        ]);
    }
    let mut acceptance = Vec::new();
    for run in runs.iter().filter(|run| run.group == Group::Recorded) {
        acceptance.extend(recorded(run));
    }
    for (fault, factor) in [(Fault::None, 1.0), (Fault::AutoZero, AUTO_ZERO_FACTOR)] {
        acceptance.extend(simulated(runs, fault, factor));
    }
    Report::new(&table, acceptance, runs)
}

fn recorded(run: &Run) -> Vec<Acceptance> {
    let factor = match run.fault {
        Fault::None => 1.0,
        Fault::AutoZero => AUTO_ZERO_FACTOR,
        _ => return Vec::new(),
    };
    let (name, fault, figures) = (&run.walk, run.fault.name(), &run.figures);
    let what = |figure: &str| match run.fault {
        Fault::None => format!("{name}: {figure}"),
        _ => format!("{name}, {fault}: {figure}"),
    };
    // A run without a pose has figures of zero, which hold nothing.
    let value = |value: f64| if figures.frames == 0 { f64::INFINITY } else { value };
    vec![
        Acceptance::at_most(what("APE, m"), value(figures.ape_m), 0.03 * factor),
        Acceptance::at_most(what("end drift, %"), value(figures.drift_percent), 0.25 * factor),
        Acceptance::at_most(what("end rotation, deg"), value(figures.rotation_deg), 0.15 * factor),
        Acceptance::at_most(
            what("standard deviation of the z error, m"),
            value(figures.z_std_m),
            0.025 * factor,
        ),
    ]
}

fn simulated(runs: &[Run], fault: Fault, factor: f64) -> Vec<Acceptance> {
    let apes = |group: Group| -> Vec<f64> {
        let of_group = runs.iter().filter(|run| run.group == group && run.fault == fault);
        of_group.map(|run| if run.figures.frames == 0 { f64::INFINITY } else { run.figures.ape_m }).collect()
    };
    let mut acceptance = Vec::new();
    for (group, limit) in [(Group::Boxes, 0.03), (Group::Rough, 0.08)] {
        let apes = apes(group);
        if apes.is_empty() {
            continue;
        }
        let name = match fault {
            Fault::None => format!("{} {}", apes.len(), group.name()),
            _ => format!("{} {}, {}", apes.len(), group.name(), fault.name()),
        };
        let (middle, largest) = (median(apes.iter().copied()), worst(apes));
        acceptance.push(Acceptance::at_most(format!("{name}: median APE, m"), middle, limit * factor));
        acceptance.push(Acceptance::at_most(format!("{name}: worst APE, m"), largest, 0.15 * factor));
    }
    acceptance
}
