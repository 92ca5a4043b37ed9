//! Least squares over all stretches: what makes the gyroscope turn as the LiDAR did.
//!
//! In a stretch the orientation of scan k is `R_k = R_0 C_k(m, s, b, t)`, with `C_k` what the gyroscope turned by since the first
//! scan and `R_0` free. The residual is the right error `Log(R_k,seen^T R_0 C_k)`.

use evac_geometry::nalgebra::{Cholesky, Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use evac_geometry::{exp_so3, log_so3};

use crate::correction::Correction;
use crate::gyro::{Gyro, Turn};
use crate::observation::Observation;

/// Unknowns: misalignment, scale, bias, time offset.
pub(crate) const UNKNOWNS: usize = 10;
pub(crate) const MISALIGNMENT: usize = 0;
pub(crate) const SCALE: usize = 3;
const BIAS: usize = 6;
pub(crate) const TIME: usize = 9;

/// What is believed before: standard deviations of misalignment (rad, 5 degrees), scale, bias (rad/s) and time offset (s).
const PRIOR: [f64; 4] = [0.087, 0.005, 0.02, 0.1];
/// Error of an orientation that the match does not know of, rad. In the units of the match's covariance, which is some
/// twenty times too wide (it counts points as dependent): 0.25 mrad.
const FLOOR: f64 = 5e-3;
/// Errors over the covariance's standard deviations were 0.7 to 1.9 (root mean squares over fifteen simulated walks): a map
/// that is off is off for longer than a stretch, and there are few stretches.
const HONESTY: f64 = 1.5;
/// ... and however long a walk is, its map leaves errors of misalignment (rad, 0.03 degrees), scale and time (s).
const LEFT: [f64; 3] = [5e-4, 3e-4, 1e-4];
/// Residuals beyond so many standard deviations count less (Huber).
const HUBER: f64 = 2.0;
const ITERATIONS: usize = 8;

pub(crate) type Unknowns = SVector<f64, UNKNOWNS>;
pub(crate) type Information = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// What was found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub(crate) correction: Correction,
    /// Covariance in the order of the unknowns.
    pub(crate) covariance: Information,
    /// Robust sum of squares, in the same units, for comparing starts.
    pub(crate) cost: f64,
}

/// Standard errors above which a direction counts as not shown, rad and seconds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(crate) misalignment: f64,
    pub(crate) time_s: f64,
}

/// One orientation's part: whitened residual and its derivatives.
struct Row {
    residual: Vector3<f64>,
    by_unknowns: SMatrix<f64, 3, UNKNOWNS>,
    by_start: Matrix3<f64>,
}

/// Normal equations of a stretch with its own first orientation eliminated.
struct Reduced {
    information: Information,
    vector: Unknowns,
}

/// Solves from `start`. `given` is what earlier passes have corrected already: the prior is about all of it.
pub(crate) fn fit(
    windows: &[&[Observation]],
    gyro: &Gyro,
    start: &Correction,
    given: &Correction,
    iterations: usize,
) -> Option<Fit> {
    let mut found = *start;
    let mut last = None;
    for _ in 0..iterations.min(ITERATIONS) + 1 {
        let (reduced, residual, cost) = normal_equations(windows, gyro, &found)?;
        let variance = residual * residual;
        let prior = Information::from_diagonal(&prior_sigmas().map(|sigma| sigma.powi(-2)));
        let data = reduced.iter().fold(Information::zeros(), |sum, part| sum + part.information) / variance;
        let pull = prior * (as_unknowns(given) + as_unknowns(&found));
        let vector = reduced.iter().fold(Unknowns::zeros(), |sum, part| sum + part.vector) / variance + pull;
        let inverse = Cholesky::new(data + prior)?.inverse();
        last = Some(Fit {
            correction: found,
            covariance: covariance(&reduced, variance, &inverse, &prior),
            cost,
        });
        let step = -(inverse * vector);
        found = added(&found, &step);
    }
    last
}

/// The larger of two covariances: that of independent residuals, and that of residuals which are alike within a stretch.
fn covariance(reduced: &[Reduced], variance: f64, inverse: &Information, prior: &Information) -> Information {
    let count = reduced.len() as f64;
    let scores = reduced.iter().fold(*prior, |sum, part| {
        let score = part.vector / variance;
        sum + score * score.transpose() * (count / (count - 1.0).max(1.0))
    });
    let clustered = inverse * scores * inverse;
    // Each unknown by the larger of its two variances; correlations are those of the clustered one.
    let scale =
        SVector::<f64, UNKNOWNS>::from_fn(|i, _| (inverse[(i, i)] / clustered[(i, i)]).max(1.0).sqrt());
    Information::from_fn(|i, j| clustered[(i, j)] * scale[i] * scale[j]) * HONESTY.powi(2)
        + Information::from_diagonal(&left().map(|sigma| sigma.powi(2)))
}

fn normal_equations(
    windows: &[&[Observation]],
    gyro: &Gyro,
    known: &Correction,
) -> Option<(Vec<Reduced>, f64, f64)> {
    let rows: Vec<Vec<Row>> = windows.iter().map(|window| settled_rows(window, gyro, known)).collect();
    let residual = spread(rows.iter().flatten());
    (residual > 0.0).then_some(())?;
    let mut cost = 0.0;
    let mut reduced = Vec::with_capacity(rows.len());
    for window in &rows {
        let (mut information, mut vector) = (Information::zeros(), Unknowns::zeros());
        let (mut start, mut mixed, mut start_vector) =
            (Matrix3::zeros(), SMatrix::<f64, UNKNOWNS, 3>::zeros(), Vector3::zeros());
        for row in window {
            let size = row.residual.norm() / residual;
            let weight = huber(size);
            cost += (weight * (2.0 - weight)) * size * size;
            let (j, e) = (row.by_unknowns, row.by_start);
            information += j.transpose() * j * weight;
            vector += j.transpose() * row.residual * weight;
            start += e.transpose() * e * weight;
            mixed += j.transpose() * e * weight;
            start_vector += e.transpose() * row.residual * weight;
        }
        let Some(inverse) = start.try_inverse() else { continue };
        reduced.push(Reduced {
            information: information - mixed * inverse * mixed.transpose(),
            vector: vector - mixed * (inverse * start_vector),
        });
    }
    Some((reduced, residual, cost * residual * residual))
}

/// Rows of a stretch at the first orientation that fits it best.
fn settled_rows(window: &[Observation], gyro: &Gyro, known: &Correction) -> Vec<Row> {
    let Some(first) = window.first() else { return Vec::new() };
    let mut turns = Vec::with_capacity(window.len());
    let (mut turn, mut now_s) = (Turn::none(), first.time_s);
    for seen in window {
        gyro.carry_on(&mut turn, now_s - known.time_offset_s, seen.time_s - known.time_offset_s, known);
        now_s = seen.time_s;
        turns.push(turn);
    }
    let mut start = first.map_from_imu;
    for _ in 0..2 {
        let rows = rows(window, &turns, gyro, known, &start);
        let scale = spread(rows.iter()).max(f64::MIN_POSITIVE);
        let (mut information, mut vector) = (Matrix3::zeros(), Vector3::zeros());
        for row in &rows {
            let weight = huber(row.residual.norm() / scale);
            information += row.by_start.transpose() * row.by_start * weight;
            vector += row.by_start.transpose() * row.residual * weight;
        }
        let Some(inverse) = information.try_inverse() else { break };
        start *= exp_so3(&-(inverse * vector));
    }
    rows(window, &turns, gyro, known, &start)
}

fn rows(
    window: &[Observation],
    turns: &[Turn],
    gyro: &Gyro,
    known: &Correction,
    start: &UnitQuaternion<f64>,
) -> Vec<Row> {
    let row = |(seen, turn): (&Observation, &Turn)| {
        let whiten = whitening(&seen.covariance)?;
        let residual = log_so3(&(seen.map_from_imu.inverse() * start * turn.rotation));
        let mut by_unknowns = SMatrix::<f64, 3, UNKNOWNS>::zeros();
        let by_time = -gyro.rate_at(seen.time_s - known.time_offset_s, known);
        by_unknowns.fixed_view_mut::<3, 3>(0, MISALIGNMENT).copy_from(&turn.by_misalignment());
        by_unknowns.fixed_view_mut::<3, 3>(0, SCALE).copy_from(&turn.by_scale);
        by_unknowns.fixed_view_mut::<3, 3>(0, BIAS).copy_from(&turn.by_bias);
        by_unknowns.fixed_view_mut::<3, 1>(0, TIME).copy_from(&by_time);
        let by_start = turn.rotation.inverse().to_rotation_matrix().into_inner();
        Some(Row {
            residual: whiten * residual,
            by_unknowns: whiten * by_unknowns,
            by_start: whiten * by_start,
        })
    };
    window.iter().zip(turns).filter_map(row).collect()
}

/// `L^-1` of the covariance `L L^T` with the floor.
fn whitening(covariance: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    Cholesky::new(covariance + Matrix3::identity() * FLOOR.powi(2))?.l().try_inverse()
}

/// Robust standard deviation of a residual's component: of a normal distribution in three dimensions half lie within 1.538.
fn spread<'a>(rows: impl Iterator<Item = &'a Row>) -> f64 {
    let mut norms: Vec<f64> = rows.map(|row| row.residual.norm()).collect();
    let middle = norms.len() / 2;
    if norms.is_empty() {
        return 0.0;
    }
    let (_, median, _) = norms.select_nth_unstable_by(middle, f64::total_cmp);
    *median / 1.538
}

/// Weight of a residual of so many standard deviations per component.
fn huber(size: f64) -> f64 {
    let limit = HUBER * 3_f64.sqrt();
    if size <= limit { 1.0 } else { limit / size }
}

fn left() -> Unknowns {
    let [misalignment, scale, time] = LEFT;
    Unknowns::from_fn(|i, _| match i {
        MISALIGNMENT..SCALE => misalignment,
        SCALE..BIAS => scale,
        BIAS..TIME => 0.0,
        _ => time,
    })
}

fn prior_sigmas() -> Unknowns {
    let [misalignment, scale, bias, time] = PRIOR;
    Unknowns::from_fn(|i, _| match i {
        MISALIGNMENT..SCALE => misalignment,
        SCALE..BIAS => scale,
        BIAS..TIME => bias,
        _ => time,
    })
}

impl Fit {
    /// `measured` with nothing corrected that the walk has not shown: the most likely correction under the condition that
    /// those directions of the misalignment, or that offset, are as they were given. (Scales are drawn to what was given by
    /// their prior.)
    pub(crate) fn shown(&self, measured: &Correction, limits: &Limits) -> Correction {
        let (mut found, mut covariance) = (as_unknowns(measured), self.covariance);
        let misalignment = covariance.fixed_view::<3, 3>(MISALIGNMENT, MISALIGNMENT).into_owned();
        let eigen = misalignment.symmetric_eigen();
        let directions = (0..3).map(|i| {
            let mut direction = Unknowns::zeros();
            direction.fixed_rows_mut::<3>(MISALIGNMENT).copy_from(&eigen.eigenvectors.column(i));
            (direction, limits.misalignment)
        });
        let time = Unknowns::from_fn(|i, _| f64::from(u8::from(i == TIME)));
        for (direction, largest) in directions.chain(std::iter::once((time, limits.time_s))) {
            let column = covariance * direction;
            let variance = direction.dot(&column);
            if variance > largest * largest {
                found -= column * (direction.dot(&found) / variance);
                covariance -= column * column.transpose() / variance;
            }
        }
        from_unknowns(&found)
    }
}

fn from_unknowns(all: &Unknowns) -> Correction {
    let part = |index: usize| all.fixed_rows::<3>(index).into_owned();
    Correction {
        misalignment: part(MISALIGNMENT),
        gyro_scale: part(SCALE),
        gyro_bias: part(BIAS),
        time_offset_s: all[TIME],
    }
}

fn as_unknowns(correction: &Correction) -> Unknowns {
    let mut all = Unknowns::zeros();
    all.fixed_rows_mut::<3>(MISALIGNMENT).copy_from(&correction.misalignment);
    all.fixed_rows_mut::<3>(SCALE).copy_from(&correction.gyro_scale);
    all.fixed_rows_mut::<3>(BIAS).copy_from(&correction.gyro_bias);
    all[TIME] = correction.time_offset_s;
    all
}

/// The misalignment's step is a left one: `C = Exp(m) C_true Exp(-m)`.
fn added(correction: &Correction, step: &Unknowns) -> Correction {
    let part = |index: usize| step.fixed_rows::<3>(index).into_owned();
    Correction {
        misalignment: log_so3(&(exp_so3(&part(MISALIGNMENT)) * exp_so3(&correction.misalignment))),
        gyro_scale: correction.gyro_scale + part(SCALE),
        gyro_bias: correction.gyro_bias + part(BIAS),
        time_offset_s: correction.time_offset_s + step[TIME],
    }
}

#[cfg(test)]
mod tests {
    use evac_frames::ImuSample;
    use evac_simulator::Random;

    use super::*;
    use crate::windows::windows;

    /// Angular velocity of a swaying walk with turns, true axes, rad/s.
    fn rate(t: f64) -> Vector3<f64> {
        Vector3::new(
            0.2 * (11.0 * t).sin(),
            0.15 * (11.0 * t + 1.0).cos(),
            0.6 * (0.7 * t).sin() + 0.1 * (5.5 * t).sin(),
        )
    }

    /// What sensors off by `off` give of 60 s, with noise of the orientations in rad.
    fn sensed(off: &Correction, noise: f64, seed: u64) -> (Gyro, Vec<Observation>) {
        let mut random = Random::new(seed, 0);
        let (mut samples, mut observations) = (Vec::new(), Vec::new());
        let mut rotation = UnitQuaternion::identity();
        for k in 0..60_000 {
            let t = f64::from(k) * 1e-3;
            if k % 5 == 0 {
                let true_rate = rate(t);
                let read = true_rate + off.gyro_scale.component_mul(&true_rate) + off.gyro_bias;
                let stamp_ns = ((t - off.time_offset_s) * 1e9) as i64;
                samples.push(ImuSample { stamp_ns, gyro: read.into(), ..ImuSample::default() });
            }
            if k % 100 == 50 {
                let given = exp_so3(&off.misalignment);
                let error = exp_so3(&(Vector3::from(random.normals()) * noise));
                observations.push(Observation {
                    time_s: t,
                    map_from_imu: given * rotation * given.inverse() * error,
                    covariance: Matrix3::identity() * 1e-6,
                    map: 0,
                });
            }
            rotation *= exp_so3(&(rate(t + 0.5e-3) * 1e-3));
        }
        (Gyro::new(&samples, 0), observations)
    }

    fn off() -> Correction {
        Correction {
            misalignment: Vector3::new(0.03, -0.02, 0.04),
            gyro_scale: Vector3::new(0.004, -0.003, 0.005),
            gyro_bias: Vector3::new(0.01, -0.005, 0.002),
            time_offset_s: 0.02,
        }
    }

    #[test]
    fn orientations_without_noise_give_back_what_the_sensors_are_off_by() {
        let (gyro, observations) = sensed(&off(), 1e-9, 1);
        let windows = windows(&observations, &gyro, 0.0);
        let found =
            fit(&windows, &gyro, &Correction::default(), &Correction::default(), 6).unwrap().correction;
        assert!((found.misalignment - off().misalignment).norm() < 1e-4, "{found:?}");
        // Readings 5 ms apart, joined by lines, miss (11 rad/s x 5 ms)^2 / 12 of a sway: 0.025 %.
        assert!((found.gyro_scale - off().gyro_scale).norm() < 5e-4, "{found:?}");
        assert!((found.gyro_bias - off().gyro_bias).norm() < 1e-5, "{found:?}");
        assert!((found.time_offset_s - off().time_offset_s).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn independent_noise_gives_errors_that_are_not_larger_than_said() {
        let mut squares = Unknowns::zeros();
        let runs = 12;
        for seed in 0..runs {
            let (gyro, observations) = sensed(&off(), 1e-3, seed);
            let windows = windows(&observations, &gyro, 0.02);
            let found = fit(&windows, &gyro, &Correction::default(), &Correction::default(), 6).unwrap();
            let error = as_unknowns(&found.correction) - as_unknowns(&off());
            squares += error.component_mul(&error).component_div(&found.covariance.diagonal());
        }
        let scores = (squares / runs as f64).map(f64::sqrt);
        // 1.5 times too wide by intent, and one of ten numbers over twelve runs.
        assert!(scores.max() < 1.1 && scores.max() > 0.3, "{scores}");
    }

    #[test]
    fn a_direction_that_is_not_shown_stays_as_given_and_the_others_follow_it() {
        let mut covariance = Information::identity() * 1e-8;
        // The misalignment about z is poorly known, and the time goes with it.
        covariance[(2, 2)] = 1.0;
        covariance[(TIME, TIME)] = 1e-6;
        covariance[(2, TIME)] = 1e-4;
        covariance[(TIME, 2)] = 1e-4;
        let fit = Fit { correction: Correction::default(), covariance, cost: 0.0 };
        let measured = Correction {
            misalignment: Vector3::new(0.01, 0.0, 0.5),
            time_offset_s: 3e-4,
            ..Correction::default()
        };
        let shown = fit.shown(&measured, &Limits { misalignment: 0.1, time_s: 0.01 });
        assert!((shown.misalignment - Vector3::new(0.01, 0.0, 0.0)).norm() < 1e-6, "{shown:?}");
        assert!((shown.time_offset_s - 2.5e-4).abs() < 1e-6, "{shown:?}");
    }
}
