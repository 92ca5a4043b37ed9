//! `evac calibrate`: how the IMU sits, keeps time and reads beside the LiDAR, from a walk.

mod cli;
mod text;

use std::io::Write as _;
use std::path::Path;

use evac_calibration::{Calibration, CalibrationError, Quantity};
use evac_experiments::read_replay;
use evac_formats::write_atomically;
use evac_odometry::LioConfig;
use evac_stage::RunError;
use serde_json::json;

pub(crate) use cli::CalibrateArgs;
use cli::{WalkArgs, What};

use crate::error::LaunchError;
use crate::finite::keys_of;
use crate::progress::Bar;

/// `evac calibrate [time|rotation|scale|all] RECORDING`.
pub(crate) fn calibrate(args: &CalibrateArgs) -> Result<(), LaunchError> {
    let (wanted, args): (&[Quantity], &WalkArgs) = match &args.what {
        Some(What::Time(args)) => (&[Quantity::Time], args),
        Some(What::Rotation(args)) => (&[Quantity::Rotation], args),
        Some(What::Scale(args)) => (&[Quantity::Scale], args),
        Some(What::All(args)) => (&Quantity::ALL, args),
        None => (&Quantity::ALL, &args.walk),
    };
    if args.duration.is_nan() || args.duration < 10.0 {
        return Err(usage(
            "--duration must be at least 10 seconds; a minute with turns shows all".to_owned(),
        ));
    }
    let name = args.recording.name();
    let rig = args.recording.rig()?;
    let keys = keys_of(&args.recording)?.into_iter().map(|(key, value)| (key.to_owned(), value));
    let replay = keys
        .collect::<toml::Table>()
        .try_into()
        .map_err(|cause: toml::de::Error| usage(format!("the recording's options: {}", cause.message())))?;
    // A folder that does not exist is said before the work, not after it.
    if let Some(folder) =
        args.output.as_deref().and_then(Path::parent).filter(|folder| !folder.as_os_str().is_empty())
    {
        crate::finite::create_folder(folder)?;
    }
    let walk = read_replay(&name, replay, &rig, args.duration)?;
    let seconds = walk.seconds(walk.frames.len().saturating_sub(1));
    let mut bar: Option<(u32, Bar)> = None;
    let found = evac_calibration::calibrate(&walk, &LioConfig::default(), |progress| {
        if bar.as_ref().is_none_or(|(pass, _)| *pass != progress.pass) {
            if let Some((_, old)) = bar.take() {
                old.end();
            }
            bar = Some((progress.pass, Bar::new(&format!("{name}, pass {}", progress.pass))));
        }
        if let Some((_, bar)) = &bar {
            bar.show(progress.frames as u64, Some(walk.frames.len() as u64));
        }
    });
    if let Some((_, bar)) = &bar {
        bar.end();
    }
    let found = found.map_err(|cause| of_walk(&name, cause))?;
    let about = format!("{name}, {seconds:.1} s");
    let report = json!({
        "evac": env!("CARGO_PKG_VERSION"),
        "recording": name,
        "seconds": seconds,
        "wanted": wanted,
        "calibration": found,
    });
    let json = format!("{report:#}\n");
    let text = if args.json { json.clone() } else { text::all(&about, &found, wanted) };
    std::io::stdout()
        .write_all(text.as_bytes())
        .map_err(|cause| LaunchError::Path(format!("standard output: {cause}; write to a file with -o")))?;
    match &args.output {
        Some(file) => write(file, &text::rig_file(&about, &found, wanted), &json),
        None => Ok(()),
    }
}

/// The rig file and calibration.json beside it, each whole or not at all.
fn write(file: &Path, rig: &str, json: &str) -> Result<(), LaunchError> {
    let beside = file.with_file_name("calibration.json");
    for (path, text) in [(file, rig), (&beside, json)] {
        write_atomically(path, |writer| writer.write_all(text.as_bytes()))?;
        eprintln!("written: {}", path.display());
    }
    Ok(())
}

fn of_walk(name: &str, cause: CalibrationError) -> LaunchError {
    match cause {
        CalibrationError::Stage(cause) => usage(format!("{name}: {cause}")),
        cause => LaunchError::Silent(format!("{name}: {cause}")),
    }
}

fn usage(cause: String) -> LaunchError {
    LaunchError::Run(RunError::Value(cause))
}

/// The rig that is written: with the rotation only if it was wanted.
fn rig_of(found: &Calibration, wanted: &[Quantity]) -> evac_config::Rig {
    if wanted.contains(&Quantity::Rotation) { found.rig } else { found.given }
}
