//! One line a run.

use evac_experiments::report::Run;

/// Names of the columns.
pub(super) fn head() -> String {
    format!(
        "{:<18} {:<17} {:>6} {:>6} {:>7} {:>7} {:>7} {:>7} {:>7} {:>7} {:>6} {:>6} {:>6} {:>5} {:>5} {:>5} {:>4} {:>6} {:>6} {:>6}  {}",
        "walk",
        "fault",
        "frames",
        "path",
        "APE",
        "max",
        "drift",
        "drift%",
        "rot",
        "z std",
        "3sig",
        "3mah",
        "jump",
        "degen",
        "lost",
        "recov",
        "time",
        "ms",
        "p99",
        "desk",
        "verdict"
    )
}

/// The figures of a run below them.
pub(super) fn of(run: &Run) -> String {
    let figures = &run.figures;
    let verdict = match &run.refused {
        Some(cause) => format!("refused: {cause}"),
        None => run.verdict.word().to_owned(),
    };
    format!(
        "{:<18} {:<17} {:>6} {:>6.1} {:>7.4} {:>7.4} {:>7.4} {:>7.3} {:>7.3} {:>7.4} {:>6.3} {:>6.3} {:>6.3} {:>5} {:>5} {:>5.1} {:>4} {:>6.2} {:>6.2} {:>6.2}  {verdict}",
        run.walk,
        run.fault.name(),
        figures.frames,
        figures.path_m,
        figures.ape_m,
        figures.ape_max_m,
        figures.drift_m,
        figures.drift_percent,
        figures.rotation_deg,
        figures.z_std_m,
        figures.within_3_sigma,
        figures.within_3_mahalanobis,
        figures.jump_m,
        figures.degenerate,
        figures.losses.frames,
        figures.losses.recovery_s,
        if figures.losses.said_in_time { "yes" } else { "no" },
        figures.median_ms,
        figures.p99_ms,
        figures.deskewer_median_ms,
    )
}
