//! `evac convert` beside OctoMap's library on the same cloud: processor time of whole processes, files compared.
//!
//! `cargo run --release -p evac-octomap-bench --bin conversion -- CLOUD.pcd`, after `cargo build --release`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};
use clap::Parser;

/// Empty where it could not be built.
const PROGRAM: &str = env!("CONVERSION_PROGRAM");

/// Converts a cloud with `evac` and with OctoMap.
#[derive(Parser)]
struct Options {
    /// Binary PCD whose first fields are x, y and z.
    cloud: PathBuf,
    /// Edges of a voxel, metres.
    #[arg(long, value_delimiter = ',', default_values_t = [0.2, 0.4, 0.8])]
    resolution: Vec<f64>,
    /// Radius of the outlier filter, metres, and others that a point needs within it.
    #[arg(long, default_value_t = 0.3)]
    radius: f64,
    #[arg(long, default_value_t = 3)]
    neighbours: u8,
    /// Runs of each, of which the median is printed.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// The command to measure.
    #[arg(long, default_value = "target/release/evac")]
    evac: PathBuf,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    if PROGRAM.is_empty() {
        println!("skipped: no comparison with OctoMap, its library was not found (Debian: liboctomap-dev)");
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let [ours, theirs] = ["ours.bt", "theirs.bt"].map(|name| folder.path().join(name));
    let filter = [options.radius.to_string(), options.neighbours.to_string()];
    let outliers = ["--outlier-radius", &filter[0], "--neighbours", &filter[1]];
    let with_ground = [outliers.as_slice(), &["--remove-ground"]].concat();
    println!("processor time of the whole process, milliseconds, median of {}", options.rounds);
    for resolution in &options.resolution {
        let edge = resolution.to_string();
        for (what, our_filters, their_filters, comparable) in [
            ("no filter", [].as_slice(), [].as_slice(), true),
            ("outliers", outliers.as_slice(), filter.as_slice(), true),
            ("outliers and ground, OctoMap outliers only", with_ground.as_slice(), filter.as_slice(), false),
        ] {
            let mut evac = Command::new(&options.evac);
            evac.arg("convert")
                .arg(&options.cloud)
                .args(["-r", &edge])
                .args(our_filters)
                .arg("-o")
                .arg(&ours);
            let mut octomap = Command::new(PROGRAM);
            // OctoMap says "done." there.
            octomap.stderr(Stdio::null());
            octomap.arg(&options.cloud).arg(&edge).arg(&theirs).args(their_filters);
            let (mut our_times, mut their_times) = (Vec::new(), Vec::new());
            // By turns, so that a busy machine is busy for both.
            for _ in 0..options.rounds.max(1) {
                our_times.push(processor_ms(&mut evac)?);
                their_times.push(processor_ms(&mut octomap)?);
            }
            let (our_ms, their_ms) = (median(our_times), median(their_times));
            print!(
                "{resolution} m, {what}: ours {our_ms:.0}, OctoMap {their_ms:.0}, ratio {:.1}",
                their_ms / our_ms
            );
            println!("{}", if comparable { same(&ours, &theirs)? } else { "" });
        }
    }
    Ok(())
}

fn same(ours: &Path, theirs: &Path) -> anyhow::Result<&'static str> {
    if fs::read(ours)? != fs::read(theirs)? {
        bail!("the files differ");
    }
    Ok(", .bt equal")
}

/// Runs a command and gives the processor time that it took.
fn processor_ms(command: &mut Command) -> anyhow::Result<f64> {
    let before = children_ms()?;
    let status = command.stdout(Stdio::null()).status().with_context(|| format!("{command:?}"))?;
    if !status.success() {
        bail!("{command:?} ended with {status}");
    }
    Ok(children_ms()? - before)
}

/// Processor time of all children that have ended: fields 16 and 17 of proc(5)'s stat, in hundredths of a second.
fn children_ms() -> anyhow::Result<f64> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    let (_, fields) = stat.rsplit_once(')').context("/proc/self/stat has no name in brackets")?;
    let ticks = |field: usize| -> anyhow::Result<f64> {
        let word = fields.split_ascii_whitespace().nth(field - 3).context("/proc/self/stat is too short")?;
        Ok(word.parse()?)
    };
    Ok(10.0 * (ticks(16)? + ticks(17)?))
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}
