//! What `evac calibrate` prints and writes.

use std::fmt::Write as _;

use evac_calibration::{Calibration, Estimate, Quantity};

use super::rig_of;

/// The table, what was not shown, and what to paste where.
pub(super) fn all(about: &str, found: &Calibration, wanted: &[Quantity]) -> String {
    let mut text = format!(
        "{about}: {} of {} scans in {} stretches, {} passes; angular rate about x, y, z: {} deg/s rms\n\n",
        found.scans,
        found.scans_in_all,
        found.stretches,
        found.passes,
        found.rms_rate_deg_s.map(|rate| format!("{rate:.1}")).join(", "),
    );
    let _ = writeln!(text, "{:<14} {:>10} {:>15}", "", "value", "standard error");
    for one in of(found, wanted) {
        let shown = if one.warning.is_some() { "  hardly shown by this walk" } else { "" };
        let _ = writeln!(
            text,
            "{:<14} {:>+10.3} {:>15.3} {}{shown}",
            one.name(),
            one.value,
            one.standard_error,
            one.unit()
        );
    }
    text.push_str("\ntime offset: to add to an IMU stamp; rotation: from the IMU's true axes to those of the rig's file;\n");
    text.push_str("gyro scale: a true rate w reads (1 + scale) w\n");
    if !found.settled {
        text.push_str("\nwarning: the last pass still changed more than a standard error; walk longer, with more turns\n");
    }
    for one in of(found, wanted) {
        if let Some(warning) = &one.warning {
            let _ = writeln!(text, "\nwarning: this walk hardly shows the {}: {warning}", one.name());
        }
    }
    if wanted.contains(&Quantity::Rotation) {
        let _ = write!(
            text,
            "\nRig file, also for a pipeline file (-o writes it):\n\n{}",
            rig_table(found, wanted)
        );
    }
    if wanted != [Quantity::Rotation] {
        let _ = write!(
            text,
            "\nPipeline file, below kind = \"lio\":\n\n[stage.config]\n{}",
            lio_keys(found, wanted)
        );
    }
    if wanted.contains(&Quantity::Time) {
        let _ = writeln!(text, "\nOr, for this recording: --imu-offset-ms (more) {:.2}", offset_ms(found));
    }
    text
}

/// The rig file. What has no place in it is a comment.
pub(super) fn rig_file(about: &str, found: &Calibration, wanted: &[Quantity]) -> String {
    let mut text = format!("# evac calibrate: {about}\n");
    for one in of(found, wanted) {
        let shown = if one.warning.is_some() { ", hardly shown" } else { "" };
        let _ = writeln!(
            text,
            "#   {:<13} {:+.3} {} (standard error {:.3}){shown}",
            one.name(),
            one.value,
            one.unit(),
            one.standard_error
        );
    }
    if wanted != [Quantity::Rotation] {
        text.push_str("# For the pipeline file, below kind = \"lio\":\n#   [stage.config]\n");
        for line in lio_keys(found, wanted).lines() {
            let _ = writeln!(text, "#   {line}");
        }
    }
    text.push_str(&rig_table(found, wanted));
    text
}

fn of<'a>(found: &'a Calibration, wanted: &'a [Quantity]) -> impl Iterator<Item = &'a Estimate> {
    found.estimates.iter().filter(|one| wanted.contains(&one.quantity))
}

fn rig_table(found: &Calibration, wanted: &[Quantity]) -> String {
    let rig = rig_of(found, wanted).imu_from_lidar;
    let angles = rig.roll_pitch_yaw_deg.map(|angle| format!("{angle:.4}")).join(", ");
    // `{:?}` keeps the point of a whole number, which TOML needs.
    format!(
        "[rig.imu_from_lidar]\ntranslation_m = {:?}\nroll_pitch_yaw_deg = [{angles}]\n",
        rig.translation_m
    )
}

fn lio_keys(found: &Calibration, wanted: &[Quantity]) -> String {
    let mut text = String::new();
    if wanted.contains(&Quantity::Time) {
        let _ = writeln!(text, "time_offset_ms = {:.2}", offset_ms(found));
    }
    if wanted.contains(&Quantity::Scale) {
        let scale: [f64; 3] = found.correction.gyro_scale.into();
        let _ = writeln!(text, "gyro_scale = [{}]", scale.map(|scale| format!("{scale:.5}")).join(", "));
    }
    text
}

fn offset_ms(found: &Calibration) -> f64 {
    found.correction.time_offset_s * 1e3
}
