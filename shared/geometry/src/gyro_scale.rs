//! Whether a gyroscope's scale and axes are those of the accelerometer beside it: gravity's direction in the sensor must turn
//! as the gyroscope says.
//!
//! Two rules, as accelerations of a walk look like turns and are no measure of a scale:
//! - Between two moments of quiet that a turn lies between, gravity has turned by as much as the readings say. That tells a scale
//!   that is twice or half what it should be, and axes that do not fit.
//! - While the sensor moves, gravity seems to turn by *more* than it does, never by much less. So readings that are several times as
//!   large are too large: degrees that are taken for radians show within seconds of any walk.

use nalgebra::{UnitQuaternion, Vector3};

use crate::exp_so3;

/// Degrees in a radian.
const DEGREES: f64 = 180.0 / std::f64::consts::PI;
/// Factors that readings may be off by: units, and ranges of such sensors.
const FACTORS: [f64; 9] = [1.0, DEGREES, 1.0 / DEGREES, 2.0, 0.5, 4.0, 0.25, 8.0, 0.125];
/// Length of a window, seconds.
const WINDOW_S: f64 = 0.5;
/// A window is quiet where the specific force varies by less than this share of gravity, and has its length to 5 %.
const QUIET: f64 = 0.03;
const LENGTH: f64 = 0.05;
/// Quiet moments farther apart say nothing: a bias has turned the readings, seconds.
const APART_S: f64 = 5.0;
/// A factor fits where gravity is found within this angle, and does not where it is farther off than that, rad.
const FITS: f64 = 0.07;
const MISSES: f64 = 0.17;
/// Turns that have to agree.
const VOTES: u32 = 2;
/// Turns of gravity by the readings that count, rad in a window; a bias alone does not reach it.
const TURN: f64 = 0.05;
/// So many of them, and so many times what is seen, are degrees: of recorded walks it was 17 to 37, 0.5 to 1 as it should be, and
/// 2.6 to 4.2 of readings that are eight times too large.
const TURNS: u32 = 10;
const TOO_LARGE: f64 = 8.0;

/// What is known of a gyroscope's scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GyroScale {
    /// It has not turned enough.
    Unknown,
    /// Gravity turned as it says.
    Right,
    /// It reads so many times the true rate.
    Times(f64),
    /// Gravity turned, but as no scale of it says: its axes are others than the accelerometer's.
    Unlike,
}

/// Watches an IMU.
#[derive(Debug, Clone)]
pub struct GyroScaleCheck {
    one_g: f64,
    last_ns: Option<i64>,
    window: Window,
    /// The window before: gravity's direction, and the mean of the angle turned by since the start.
    before: Option<(Vector3<f64>, Vector3<f64>)>,
    /// The newest quiet window's gravity, the time since its end, and what the sensor has turned by since then by each factor.
    quiet: Option<(Vector3<f64>, f64)>,
    turned: [UnitQuaternion<f64>; FACTORS.len()],
    /// Sum of the readings, rad.
    angle: Vector3<f64>,
    votes: [u32; FACTORS.len()],
    unlike: u32,
    /// Squares of gravity's turns as read and as seen, and how many.
    read: f64,
    seen: f64,
    turns: u32,
}

#[derive(Debug, Clone, Copy, Default)]
struct Window {
    seconds: f64,
    samples: f64,
    force: Vector3<f64>,
    low: Vector3<f64>,
    high: Vector3<f64>,
    angle: Vector3<f64>,
}

impl GyroScaleCheck {
    /// `one_g` is gravity in the unit of the samples.
    pub fn new(one_g: f64) -> Self {
        Self {
            one_g,
            last_ns: None,
            window: Window::default(),
            before: None,
            quiet: None,
            turned: [UnitQuaternion::identity(); FACTORS.len()],
            angle: Vector3::zeros(),
            votes: [0; FACTORS.len()],
            unlike: 0,
            read: 0.0,
            seen: 0.0,
            turns: 0,
        }
    }

    /// Takes in a sample: its time, the rate in rad/s as far as is known, and the specific force.
    pub fn push(&mut self, stamp_ns: i64, gyro: [f64; 3], accel: [f64; 3]) {
        let step_s = self.last_ns.map_or(0.0, |last| stamp_ns.saturating_sub(last) as f64 * 1e-9);
        self.last_ns = Some(stamp_ns);
        if !(0.0..0.1).contains(&step_s) {
            // What it turned by in the gap is not known.
            (self.window, self.before, self.quiet) = (Window::default(), None, None);
            return;
        }
        let turn = Vector3::from(gyro) * step_s;
        self.angle += turn;
        if let Some((_, since_s)) = &mut self.quiet {
            *since_s += step_s;
            for (turned, factor) in self.turned.iter_mut().zip(FACTORS) {
                *turned *= exp_so3(&(turn / factor));
            }
        }
        self.window.push(step_s, accel.into(), &self.angle);
        if self.window.seconds >= WINDOW_S {
            let window = std::mem::take(&mut self.window);
            self.compare(&window);
        }
    }

    /// What all samples so far have shown.
    pub fn verdict(&self) -> GyroScale {
        let most = (0..FACTORS.len()).max_by_key(|at| self.votes[*at]).unwrap_or_default();
        let others = self.votes.iter().sum::<u32>() - self.votes[most];
        if self.votes[most] >= VOTES && self.votes[most] > others.max(self.unlike) {
            return if most == 0 { GyroScale::Right } else { GyroScale::Times(FACTORS[most]) };
        }
        if self.unlike >= VOTES && self.unlike > self.votes[most] {
            return GyroScale::Unlike;
        }
        if self.turns >= TURNS && self.read > TOO_LARGE.powi(2) * self.seen {
            return GyroScale::Times(DEGREES);
        }
        GyroScale::Unknown
    }

    fn compare(&mut self, window: &Window) {
        let mean = window.force / window.samples;
        let length = mean.norm();
        if length < 0.5 * self.one_g {
            (self.before, self.quiet) = (None, None);
            return;
        }
        let (gravity, angle) = (mean / length, window.angle / window.samples);
        if let Some((gravity_before, angle_before)) = self.before.replace((gravity, angle)) {
            let read = ((gravity_before + gravity) / 2.0).cross(&(angle - angle_before)).norm_squared();
            if read > TURN.powi(2) {
                self.read += read;
                self.seen += (gravity - gravity_before).norm_squared();
                self.turns = self.turns.saturating_add(1);
            }
        }
        let is_quiet = (window.high - window.low).max() < QUIET * self.one_g
            && (length / self.one_g - 1.0).abs() < LENGTH;
        if is_quiet {
            if let Some((gravity_before, since_s)) = self.quiet.replace((gravity, 0.0))
                && since_s < APART_S
            {
                self.vote(&gravity_before, &gravity);
            }
            self.turned = [UnitQuaternion::identity(); FACTORS.len()];
        }
    }

    /// Which factors take gravity from where it was to where it is.
    fn vote(&mut self, from: &Vector3<f64>, to: &Vector3<f64>) {
        if from.angle(to) < MISSES {
            return;
        }
        let off = self.turned.map(|turned| (turned.inverse() * from).angle(to));
        let best = (1..FACTORS.len()).min_by(|a, b| off[*a].total_cmp(&off[*b])).unwrap_or_default();
        if off[0] < FITS {
            self.votes[0] += 1;
        } else if off[0] > MISSES && off[best] < FITS {
            self.votes[best] += 1;
        } else if off[0] > MISSES {
            self.unlike += 1;
        }
    }
}

impl Window {
    fn push(&mut self, step_s: f64, force: Vector3<f64>, angle: &Vector3<f64>) {
        let first = self.samples == 0.0;
        self.low = if first { force } else { self.low.inf(&force) };
        self.high = if first { force } else { self.high.sup(&force) };
        self.seconds += step_s;
        self.samples += 1.0;
        self.force += force;
        self.angle += angle;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds of quiet and turns about x by 40 degrees, to and fro, as a sensor gives them whose readings `read` makes of true rates.
    fn tilted(read: impl Fn(Vector3<f64>) -> Vector3<f64>) -> GyroScale {
        let mut check = GyroScaleCheck::new(9.81);
        let (mut attitude, period) = (UnitQuaternion::identity(), 0.005);
        for k in 0..4000_i64 {
            let t = k as f64 * period % 4.0;
            // Quiet, over in a second, quiet, back in a second.
            let speed = if (1.0..2.0).contains(&t) {
                0.7
            } else if (3.0..4.0).contains(&t) {
                -0.7
            } else {
                0.0
            };
            let rate = Vector3::new(speed, 0.1 * speed, 0.2 * speed);
            attitude *= exp_so3(&(rate * period));
            let force = attitude.inverse() * Vector3::z() * 9.81 + Vector3::repeat(0.02 * (k % 5) as f64);
            check.push(k * 5_000_000, read(rate).into(), force.into());
        }
        check.verdict()
    }

    #[test]
    fn turns_between_quiet_moments_tell_every_scale_and_unlike_axes() {
        let bias = Vector3::new(0.004, -0.006, 0.005);
        assert_eq!(tilted(|rate| rate + bias), GyroScale::Right);
        for factor in FACTORS.into_iter().skip(1) {
            assert_eq!(tilted(|rate| rate * factor), GyroScale::Times(factor));
        }
        assert_eq!(tilted(|rate| rate.yxz()), GyroScale::Unlike);
        assert_eq!(tilted(|rate| -rate), GyroScale::Unlike);
        // A few percent are another's to find.
        assert_eq!(tilted(|rate| rate * 1.05), GyroScale::Right);
    }

    #[test]
    fn rest_with_a_bias_and_gaps_say_nothing() {
        let mut check = GyroScaleCheck::new(9.81);
        for k in 0..6000_i64 {
            check.push(k * 5_000_000, [0.01, -0.008, 0.005], [0.0, 0.1, 9.8]);
        }
        for k in 0..100_i64 {
            check.push(60_000_000_000 + k * 1_000_000_000, [1.0; 3], [9.8, 0.0, 0.1]);
        }
        assert!(matches!(check.verdict(), GyroScale::Unknown | GyroScale::Right), "{:?}", check.verdict());
    }
}
