//! Pictures of what was measured.

use evac_picture::{LineChart, line_chart};

use crate::support::is_trial;

/// Draws a chart into `$EVAC_PLOTS`, where that is set and this is no trial run.
pub(crate) fn plot(name: &str, chart: &LineChart) -> anyhow::Result<()> {
    let Some(folder) = std::env::var_os("EVAC_PLOTS").filter(|_| !is_trial()) else { return Ok(()) };
    let path = std::path::Path::new(&folder).join(format!("{name}.png"));
    line_chart(&path, chart)?;
    println!("{}", path.display());
    Ok(())
}
