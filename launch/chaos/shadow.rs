//! A shadow under fire: compared with the instance that leads by `evac compare` itself, then promoted or ended.

use std::process::Command;

use evac_ports::Domain;
use serde_json::Value;

use super::ChaosArgs;
use super::deed::PATIENCE;
use crate::control::{self, Order, Request};

/// Scans over which the two are compared.
const SCANS: f64 = 20.0;
/// Of the simulator in real time.
const RATE_HZ: f64 = 10.0;

/// What the comparison said and what was done with the shadow, or what went wrong.
pub(super) fn compare_and_end(
    domain: &Domain,
    stage: &str,
    args: &ChaosArgs,
    promote: bool,
) -> Result<String, String> {
    let compared = compare(domain, stage, args)?;
    let order = if promote { Order::Promote } else { Order::Unshadow };
    let request = Request {
        order,
        stage: stage.to_owned(),
        kind: None,
        run: None,
        config: None,
        patience_s: PATIENCE.as_secs_f64(),
    };
    control::ask(domain, &request, |_| ()).map_err(|cause| cause.to_string())?;
    Ok(format!("{compared}; {}", if promote { "promoted" } else { "ended" }))
}

fn compare(domain: &Domain, stage: &str, args: &ChaosArgs) -> Result<String, String> {
    let program = std::env::current_exe().map_err(|cause| cause.to_string())?;
    let said = Command::new(program)
        .args(["compare", stage, "--json", "--domain", domain.name()])
        .args(["--duration", &(SCANS / RATE_HZ / args.rate).to_string()])
        .arg("--output")
        .arg(args.output.join(format!("compare-{stage}")))
        .output()
        .map_err(|cause| format!("evac compare: {cause}"))?;
    if !said.status.success() {
        return Err(format!("evac compare: {}", String::from_utf8_lossy(&said.stderr).trim()));
    }
    let json: Value =
        serde_json::from_slice(&said.stdout).map_err(|cause| format!("evac compare: {cause}"))?;
    let deviations = json.get("deviation").and_then(Value::as_object);
    let deviations = deviations.into_iter().flatten().map(|(what, spread)| {
        let median = spread.get("median").and_then(Value::as_f64).unwrap_or(f64::NAN);
        format!("{what} {median:.3}")
    });
    let frames = json.get("frames").and_then(Value::as_u64).unwrap_or(0);
    Ok(format!("{frames} frames of both, in the median {}", deviations.collect::<Vec<_>>().join(", ")))
}
