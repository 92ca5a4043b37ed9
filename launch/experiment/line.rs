//! One line a run.

use evac_experiments::{Figures, Trajectory, Verdict};

/// Names of the columns.
pub(crate) fn head() -> String {
    format!(
        "{:<20} {:<18} {:>6} {:>6} {:>7} {:>7} {:>7} {:>7} {:>7} {:>7} {:>6} {:>6} {:>6} {:>5} {:>5} {:>5} {:>5} {:>6} {:>6} {:>6}  {}",
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
        "lio",
        "p99",
        "desk",
        "verdict"
    )
}

pub(crate) fn of(walk: &str, fault: &str, run: &Trajectory, figures: &Figures) -> String {
    let verdict = match (Verdict::of(run, figures), &run.refused) {
        (Verdict::Refused, Some(cause)) => format!("refused: {cause}"),
        (verdict, _) => format!("{verdict:?}").to_lowercase(),
    };
    format!(
        "{walk:<20} {fault:<18} {:>6} {:>6.1} {:>7.4} {:>7.4} {:>7.4} {:>7.3} {:>7.3} {:>7.4} {:>6.3} {:>6.3} {:>6.3} {:>5} {:>5} {:>5.1} {:>5} {:>6.2} {:>6.2} {:>6.2}  {verdict}",
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
        figures.lost,
        figures.recovery_s,
        if figures.said_in_time { "yes" } else { "no" },
        figures.median_ms,
        figures.p99_ms,
        figures.deskewer_median_ms,
    )
}
