//! `evac compare`: two instances of one stage on the same input, how far their outputs are apart and what each costs.

mod cli;
mod deviation;
mod live;
mod pairs;
mod recording;
mod report;

use evac_stage::RunError;

pub(crate) use cli::{COMPARE_HELP, CompareArgs};

use crate::error::LaunchError;
use crate::finite::create_folder;

/// `evac compare STAGE` and `evac compare RECORDING --a lio --b loam`.
pub(crate) fn compare(args: &CompareArgs) -> Result<(), LaunchError> {
    if args.duration.is_some_and(|seconds| seconds.is_nan() || seconds <= 0.0) {
        return Err(usage("--duration must be more than 0 seconds".to_owned()));
    }
    create_folder(&args.output)?;
    let comparison = match (args.a, args.b) {
        (Some(a), Some(b)) => recording::compare(args, [a, b])?,
        _ if args.what.is_file() || args.what.components().count() > 1 => {
            return Err(usage(format!(
                "{} is a recording; say what is to be compared over it, for example --a lio --b loam",
                args.what.display()
            )));
        }
        _ => live::compare(args)?,
    };
    comparison.write(&args.output)?;
    if args.json {
        println!("{}", comparison.json());
    } else {
        print!("{}", comparison.table());
        println!("{}", args.output.join("compare.png").display());
    }
    Ok(())
}

fn usage(cause: String) -> LaunchError {
    LaunchError::Run(RunError::Value(cause))
}
