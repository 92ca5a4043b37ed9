//! Passes over a walk until the correction settles.

use evac_experiments::Walk;
use evac_geometry::nalgebra::Vector3;
use evac_odometry::LioConfig;
use evac_stage::StageError;

use crate::correction::Correction;
use crate::fit::{Fit, Limits, MISALIGNMENT, SCALE, TIME, Unknowns, fit};
use crate::gyro::Gyro;
use crate::observation::{Observation, observe};
use crate::result::{Calibration, Estimate, Quantity, remedy};
use crate::windows::windows;

/// Passes at most, and of these such that only bring the clocks near each other.
const MAX_PASSES: u32 = 7;
const MAX_CLOCK_PASSES: u32 = 3;
/// Clock offset with which the odometry goes astray, seconds.
const FAR_OFF_S: f64 = 0.015;
/// A pass that changes every number by less than its standard error is the last: the map is another one in every pass, so
/// smaller changes never end.
const SETTLED: f64 = 1.0;
/// Clock offsets from which the first pass starts, seconds: the best of them is within what least squares can follow.
const OFFSETS_S: f64 = 0.15;
const OFFSET_STEP_S: f64 = 0.01;
/// What the odometry expects in the first pass, whose rig may be off by degrees and whose clocks by tenths of a second.
const FIRST_MISALIGNMENT_DEG: f64 = 2.0;
const FIRST_GYRO_SCALE: f64 = 0.006;
/// Standard errors beyond so many times those warned of.
const GIVEN_IS_BETTER: f64 = 4.0;
/// Stretches below which standard errors mean nothing.
const MIN_STRETCHES: usize = 3;

/// How far the work is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Passes begun.
    pub pass: u32,
    /// Frames of this pass done.
    pub frames: usize,
}

/// Why nothing can be said.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// Deskewer or odometry gave up.
    #[error("{0}")]
    Stage(#[from] StageError),
    /// Too few scans fit a map.
    #[error(
        "only {stretches} stretches of some seconds have scans that fit each other ({scans} of {scans_in_all} scans); \
         walk for a minute with turns where walls are in view, and begin with two seconds of standing"
    )]
    TooLittle {
        /// Stretches found.
        stretches: usize,
        /// Scans in them.
        scans: usize,
        /// Scans in the walk.
        scans_in_all: usize,
    },
    /// The equations have no solution.
    #[error("the scans do not fit any rotation and clock; check that LiDAR and IMU are of the same walk")]
    NoFit,
}

/// Calibrates from a walk. `lio` is how the odometry is configured, `told` hears of every frame.
///
/// # Errors
/// [`CalibrationError`].
pub fn calibrate(
    walk: &Walk,
    lio: &LioConfig,
    mut told: impl FnMut(Progress),
) -> Result<Calibration, CalibrationError> {
    let mut correction = Correction::default();
    let (mut pass, mut first) = (0, true);
    loop {
        pass += 1;
        let corrected = correction.applied(walk);
        let found = one_pass(&corrected, config(lio, first), &correction, first, |frames| {
            told(Progress { pass, frames });
        })?;
        let offset_s = found.fit.correction.time_offset_s;
        if first && offset_s.abs() > FAR_OFF_S && pass < MAX_CLOCK_PASSES {
            // The odometry has gone astray with such a clock: all else would be found by a bad map.
            correction.time_offset_s += offset_s;
            continue;
        }
        let measured = correction.then(&found.fit.correction);
        let next = found.fit.shown(&measured, &limits());
        let settled = !first && found.change(&correction, &next) < SETTLED;
        if settled || pass == MAX_PASSES {
            return Ok(report(walk, (&measured, &next), &found, pass, settled));
        }
        (correction, first) = (next, false);
    }
}

/// What is known worse than this is left as it was given: a rig's file is mostly better than that.
fn limits() -> Limits {
    let [misalignment, time] =
        [Quantity::Rotation, Quantity::Time].map(|quantity| quantity.largest_error() * GIVEN_IS_BETTER);
    Limits { misalignment: misalignment.to_radians(), time_s: time * 1e-3 }
}

/// The odometry's configuration: wide at first; later what remains is small.
fn config(lio: &LioConfig, first: bool) -> LioConfig {
    let wide = LioConfig {
        misalignment_sigma_deg: lio.misalignment_sigma_deg.max(FIRST_MISALIGNMENT_DEG),
        gyro_scale_sigma: lio.gyro_scale_sigma.max(FIRST_GYRO_SCALE),
        ..*lio
    };
    if first { wide } else { *lio }
}

struct Pass {
    fit: Fit,
    scans: usize,
    stretches: usize,
    rms_rate: Vector3<f64>,
}

impl Pass {
    /// The largest change from one correction to the next in units of its standard error.
    fn change(&self, before: &Correction, after: &Correction) -> f64 {
        let error = |index: usize| self.fit.covariance[(index, index)].sqrt();
        let three = |index: usize, change: Vector3<f64>| {
            (0..3).map(|axis| change[axis].abs() / error(index + axis)).fold(0.0, f64::max)
        };
        three(MISALIGNMENT, after.misalignment - before.misalignment)
            .max(three(SCALE, after.gyro_scale - before.gyro_scale))
            .max((after.time_offset_s - before.time_offset_s).abs() / error(TIME))
    }
}

fn one_pass(
    walk: &Walk,
    lio: LioConfig,
    given: &Correction,
    first: bool,
    told: impl FnMut(usize),
) -> Result<Pass, CalibrationError> {
    let reference_ns = walk.frames.first().map_or(0, |frame| frame.header.frame.start_ns);
    let gyro = Gyro::new(&walk.imu(), reference_ns);
    let observations = observe(walk, lio, reference_ns, told)?;
    let given = Correction { gyro_bias: Vector3::zeros(), ..*given };
    let start = if first { coarse(&observations, &gyro, &given) } else { Some(Correction::default()) };
    let start = start.unwrap_or_default();
    let windows = windows(&observations, &gyro, start.time_offset_s);
    let scans = windows.iter().map(|window| window.len()).sum();
    if windows.len() < MIN_STRETCHES {
        let scans_in_all = walk.frames.len();
        return Err(CalibrationError::TooLittle { stretches: windows.len(), scans, scans_in_all });
    }
    let fit = fit(&windows, &gyro, &start, &given, ITERATIONS).ok_or(CalibrationError::NoFit)?;
    Ok(Pass { fit, scans, stretches: windows.len(), rms_rate: gyro.rms_rate() })
}

/// Iterations of the fit of a pass and of each start of the first.
const ITERATIONS: usize = 6;
const COARSE_ITERATIONS: usize = 1;

/// The clock offset whose fit is best.
fn coarse(observations: &[Observation], gyro: &Gyro, given: &Correction) -> Option<Correction> {
    let windows = windows(observations, gyro, 0.0);
    let steps = (OFFSETS_S / OFFSET_STEP_S).round() as i32;
    let fits = (-steps..=steps).filter_map(|step| {
        let time_offset_s = f64::from(step) * OFFSET_STEP_S;
        fit(&windows, gyro, &Correction { time_offset_s, ..Correction::default() }, given, COARSE_ITERATIONS)
    });
    fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|best| best.correction)
}

fn report(
    walk: &Walk,
    (measured, correction): (&Correction, &Correction),
    found: &Pass,
    passes: u32,
    settled: bool,
) -> Calibration {
    let errors: Unknowns = found.fit.covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
    let estimate = |quantity: Quantity, axis: Option<usize>, value: f64, error: f64, unit: f64| {
        let standard_error = error * unit;
        let shown = standard_error <= quantity.largest_error();
        let warning = (!shown).then(|| remedy(quantity, axis));
        Estimate { quantity, axis, value: value * unit, standard_error, warning }
    };
    let mut estimates = vec![estimate(Quantity::Time, None, measured.time_offset_s, errors[TIME], 1e3)];
    let degrees = 1_f64.to_degrees();
    estimates.extend((0..3).map(|axis| {
        let (value, error) = (measured.misalignment[axis], errors[MISALIGNMENT + axis]);
        estimate(Quantity::Rotation, Some(axis), value, error, degrees)
    }));
    estimates.extend((0..3).map(|axis| {
        let (value, error) = (measured.gyro_scale[axis], errors[SCALE + axis]);
        estimate(Quantity::Scale, Some(axis), value, error, 100.0)
    }));
    Calibration {
        correction: *correction,
        given: walk.rig,
        rig: correction.rig(&walk.rig),
        estimates,
        scans: found.scans,
        scans_in_all: walk.frames.len(),
        stretches: found.stretches,
        passes,
        settled,
        rms_rate_deg_s: found.rms_rate.map(f64::to_degrees).into(),
    }
}
