//! What faults do.

use super::{Acceptance, Report, Run, Table, median, short, worst};
use crate::{Fault, Verdict};

/// One row a fault over all walks: APE within 0.2 m, or lost, said in time and recovered; never a jump over 0.3 m.
pub fn robustness(runs: &[Run]) -> Report {
    let mut table = Table::new(&[
        "fault",
        "median APE m",
        "worst APE m",
        "largest jump m",
        "held",
        "recovered",
        "failed",
        "which",
    ]);
    let mut acceptance = Vec::new();
    for fault in Fault::ALL {
        let of_fault: Vec<_> = runs.iter().filter(|run| run.fault == fault).collect();
        if of_fault.is_empty() {
            continue;
        }
        let count = |verdict: Verdict| of_fault.iter().filter(|run| run.verdict == verdict).count();
        // A fault that evac cannot work with must be refused with a reason; that is no failure.
        let refused = count(Verdict::Refused);
        let failed: Vec<_> = of_fault
            .iter()
            .filter(|run| run.verdict == Verdict::Failed)
            .map(|run| format!("{} ({})", run.walk, short(run.figures.ape_m)))
            .collect();
        let apes = || of_fault.iter().filter(|run| run.refused.is_none()).map(|run| run.figures.ape_m);
        table.row([
            fault.name(),
            format!("{:.4}", median(apes())),
            format!("{:.4}", worst(apes())),
            format!("{:.3}", worst(of_fault.iter().map(|run| run.figures.jump_m))),
            count(Verdict::Held).to_string(),
            match refused {
                0 => count(Verdict::Recovered).to_string(),
                refused => format!("{} ({refused} refused)", count(Verdict::Recovered)),
            },
            failed.len().to_string(),
            failed.join(", "),
        ]);
        acceptance.push(Acceptance::at_most(
            format!("{}: runs that fail", fault.name()),
            failed.len() as f64,
            0.0,
        ));
    }
    Report::new(&table, acceptance, runs)
}
