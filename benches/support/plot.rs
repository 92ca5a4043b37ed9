//! Pictures of what was measured.
#![allow(dead_code)] // not every bench needs all of it

use evac_picture::{LineChart, Panel, Series, Stroke, line_chart};

use crate::support::is_trial;

/// Draws a chart into `$EVAC_PLOTS`, where that is set and this is no trial run.
pub(crate) fn plot(name: &str, chart: &LineChart) -> anyhow::Result<()> {
    let Some(folder) = std::env::var_os("EVAC_PLOTS").filter(|_| !is_trial()) else { return Ok(()) };
    let path = std::path::Path::new(&folder).join(format!("{name}.png"));
    line_chart(&path, chart)?;
    println!("{}", path.display());
    Ok(())
}

/// A panel of cumulative distributions: over each value the share that is at most as large.
pub(crate) fn distributions<'a>(
    y_label: impl Into<String>,
    values: impl IntoIterator<Item = (&'a str, Vec<f64>)>,
) -> Panel {
    let series = values.into_iter().enumerate().map(|(number, (name, mut values))| {
        values.sort_by(f64::total_cmp);
        let count = values.len() as f64;
        let shares = values.iter().enumerate().map(|(i, value)| [*value, (i + 1) as f64 / count]);
        Series::line(name, Stroke::nth(number), shares.collect())
    });
    Panel { y_label: y_label.into(), y_range: Some([0.0, 1.0]), series: series.collect(), ..Panel::default() }
}
