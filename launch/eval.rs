//! `evac eval`: trajectories against the truth, as a table, as JSON and as pictures.

pub(crate) mod plots;
mod table;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use evac_evaluation::{Evaluation, EvaluationError, Pairs, Side, associate, associate_absolute};
use evac_formats::tum::{self, TumPose};
use evac_formats::write_atomically;
use serde::Serialize;
use serde_json::json;

use crate::cli::EvalArgs;
use crate::error::LaunchError;
use crate::finite::create_folder;

/// A trajectory with its figures.
#[derive(Debug, Serialize)]
pub(crate) struct Evaluated {
    /// Name of its column and line: the file's, or the whole path where two files have one name.
    pub(crate) name: String,
    /// The file.
    pub(crate) file: PathBuf,
    /// Poses of it at which the truth is not known.
    pub(crate) frames_without_truth: usize,
    /// What was added to its stamps to find the truth, seconds.
    pub(crate) time_offset_s: f64,
    /// Its figures.
    #[serde(flatten)]
    pub(crate) figures: Evaluation,
    /// Its poses beside the true ones.
    #[serde(skip)]
    pub(crate) pairs: Pairs,
}

/// `evac eval TRUTH.tum ESTIMATE.tum...`.
pub(crate) fn eval(args: &EvalArgs) -> Result<(), LaunchError> {
    let truth = tum::read(&args.truth)?;
    let names = names(&args.estimates);
    let evaluated = args
        .estimates
        .iter()
        .zip(names)
        .map(|(file, name)| evaluate(args, &truth, file, name))
        .collect::<Result<Vec<_>, _>>()?;

    create_folder(&args.output)?;
    let report = json!({
        "evac": env!("CARGO_PKG_VERSION"),
        "truth": args.truth,
        "times": if args.absolute_time { "absolute" } else { "from the first pose" },
        "estimates": evaluated,
    });
    let files = ["evaluation.json", "path.png", "axes.png"].map(|name| args.output.join(name));
    let [figures, paths, axes] = &files;
    write_atomically(figures, |writer| writeln!(writer, "{report:#}"))?;
    let tracks = plots::tracks(&truth, evaluated.iter().map(|one| (one.name.as_str(), &one.pairs)));
    evac_picture::plot_paths(paths, "Path from above", &tracks)?;
    evac_picture::plot_axes(axes, "Position over time", &tracks)?;

    print(&if args.json {
        format!("{report:#}\n")
    } else {
        let folder = args.output.display();
        format!("{}in {folder}: evaluation.json, path.png, axes.png\n", table::table(&evaluated))
    })
}

/// A reader that has seen enough (`| head`) is no failure: the files are written.
fn print(text: &str) -> Result<(), LaunchError> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(cause) if cause.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(LaunchError::Path(format!("standard output: {cause}; the results are in the folder")))
        }
        _ => Ok(()),
    }
}

fn evaluate(args: &EvalArgs, truth: &[TumPose], file: &Path, name: String) -> Result<Evaluated, LaunchError> {
    let estimate = tum::read(file)?;
    let pairs = if args.absolute_time { associate_absolute } else { associate }(truth, &estimate)
        .map_err(|cause| in_file(args, file, &cause))?;
    let Some(figures) = Evaluation::of(&pairs) else {
        return Err(LaunchError::Path(format!("{}: fewer than 2 frames can be compared", file.display())));
    };
    if let Some(note) = note(truth, &estimate, &pairs) {
        eprintln!("{}: {note}", file.display());
    }
    let file = file.to_owned();
    let (frames_without_truth, time_offset_s) = (pairs.without_truth(), pairs.offset_ns() as f64 * 1e-9);
    Ok(Evaluated { name, file, frames_without_truth, time_offset_s, figures, pairs })
}

/// An error with the file that it is in.
fn in_file(args: &EvalArgs, estimate: &Path, cause: &EvaluationError) -> LaunchError {
    let file = match cause {
        EvaluationError::TooFew { side: Side::Truth, .. }
        | EvaluationError::NotMonotonic { side: Side::Truth, .. }
        | EvaluationError::NotFinite { side: Side::Truth, .. } => &args.truth,
        _ => estimate,
    };
    let option = match cause {
        EvaluationError::NoOverlap { .. } if args.absolute_time => " (leave --absolute-time out)",
        EvaluationError::NoOverlap { .. } => " (--absolute-time)",
        _ => "",
    };
    LaunchError::Path(format!("{}: {cause}{option}", file.display()))
}

/// Trajectories on one clock that begin at different moments must not be laid on each other in time.
fn note(truth: &[TumPose], estimate: &[TumPose], pairs: &Pairs) -> Option<String> {
    let span = |poses: &[TumPose]| Some([poses.first()?.stamp_ns, poses.last()?.stamp_ns]);
    let ([t0, t1], [e0, e1]) = (span(truth)?, span(estimate)?);
    let overlap = t0 <= e1 && e0 <= t1;
    let offset_s = pairs.offset_ns() as f64 * 1e-9;
    (overlap && offset_s.abs() > 1e-3).then(|| {
        let when = if offset_s < 0.0 { "after" } else { "before" };
        format!(
            "begins {:.3} s {when} the truth by its stamps, taken as the same moment; use --absolute-time if both are on one clock",
            offset_s.abs()
        )
    })
}

/// The files' names without their endings, or the paths where that does not tell them apart.
fn names(files: &[PathBuf]) -> Vec<String> {
    let stem = |file: &PathBuf| file.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let stems: Vec<_> = files.iter().map(|file| stem(file).unwrap_or_default()).collect();
    let unique =
        stems.iter().enumerate().all(|(i, stem)| stems.iter().skip(i + 1).all(|other| other != stem));
    if unique { stems } else { files.iter().map(|file| file.display().to_string()).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_one_name_are_told_apart_by_their_paths() {
        let files = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        assert_eq!(names(&files(&["out/loam.tum", "lio.tum"])), ["loam", "lio"]);
        assert_eq!(names(&files(&["a/t.tum", "b/t.tum"])), ["a/t.tum", "b/t.tum"]);
    }
}
