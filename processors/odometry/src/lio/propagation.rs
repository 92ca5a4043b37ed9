//! Propagation of state and covariance by the IMU (design section 5.2), with gaps (5.8).

use evac_geometry::nalgebra::{Matrix3, SMatrix, Vector3};
use evac_geometry::{exp_so3, log_so3, skew};

use super::config::LioConfig;
use super::habit::Habit;
use super::imu::{Reading, between};
use super::state::{Covariance, DIM, MOVING, OWN, State, add_variance, at};

/// White noise is given per sample at this period.
const NOISE_PERIOD_S: f64 = 0.005;
/// Readings farther apart than this are a gap: two samples at 100 Hz or three at 200 Hz are missing.
const GAP_S: f64 = 0.025;
/// The last reading is believed to hold for so long.
const HOLD_NS: i64 = 30_000_000;
/// While the gyroscope's auto-zero holds, rates up to about 1 degree/s are hidden; as white noise per sample.
const HELD_GYRO_NOISE: f64 = 0.03;
/// As above for a rig that has been at rest for a while.
const RESTING_GYRO_NOISE: f64 = 0.002;
/// Longest gap across which readings are interpolated, seconds; beyond it a walker has swung to and fro meanwhile.
const INTERPOLATED_S: f64 = 0.1;
/// Rotation rate and acceleration of a walking carrier that a short gap may hide, rad/s and m/s^2 (standard deviations).
const HIDDEN_RATE: f64 = 0.5;
const HIDDEN_ACCEL: f64 = 2.0;
/// Least rotation that a long one hides, as white noise, rad^2/s: 2 degrees in a tenth of a second.
const BLIND_ROTATION: f64 = 0.01;
/// Time in which a walker's velocity goes back to its mean, seconds.
const SWING_S: f64 = 0.1;
/// Time in which a walker's rate of rotation is forgotten, seconds: it swings twice a second.
const RATE_MEMORY_S: f64 = 0.07;
/// Pieces in which a long gap is gone through.
const PIECE_NS: i64 = 20_000_000;

/// Noise of the loose mode after a loss (design section 4: never diverges).
const LOOSE_GYRO_NOISE: f64 = 0.01;
const LOOSE_ACCEL_NOISE: f64 = 0.3;

/// What the propagation adds to the covariance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    gyro: f64,
    /// While the gyroscope is held at zero.
    held_gyro: f64,
    accel: f64,
    gyro_walk: f64,
    accel_walk: f64,
    offset_walk: f64,
}

impl Noise {
    /// Configured noise with its variance times `factor`, or the loose mode's; `offset_walk` is the random walk of the time offset,
    /// s per sqrt(s).
    pub(crate) fn new(config: &LioConfig, factor: f64, loose: bool, at_rest: bool, offset_walk: f64) -> Self {
        let scale = factor.sqrt();
        let floor = if loose { (LOOSE_GYRO_NOISE, LOOSE_ACCEL_NOISE) } else { (0.0, 0.0) };
        Self {
            gyro: (config.gyro_noise_rad_s * scale).max(floor.0),
            held_gyro: if at_rest { RESTING_GYRO_NOISE } else { HELD_GYRO_NOISE },
            accel: (config.accel_noise_m_s2 * scale).max(floor.1),
            gyro_walk: config.gyro_bias_walk,
            accel_walk: config.accel_bias_walk,
            offset_walk,
        }
    }
}

/// Where the IMU was at one instant inside the frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TracePoint {
    pub(crate) stamp_ns: i64,
    pub(crate) state: State,
    /// Angular velocity without bias, rad/s, IMU frame.
    pub(crate) rate: Vector3<f64>,
}

impl TracePoint {
    /// The way from `before` to `end` in `seconds`, up to `end_ns`, steady: as far as two scans show it.
    pub(crate) fn on_the_way(before: &State, end: &State, end_ns: i64, seconds: f64) -> Self {
        let velocity = (end.position - before.position) / seconds;
        let rate = log_so3(&(before.rotation.inverse() * end.rotation)) / seconds;
        Self { stamp_ns: end_ns - (seconds * 1e9) as i64, state: State { velocity, ..*before }, rate }
    }
}

/// Gaps between readings that a propagation bridged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Bridged {
    pub(crate) gaps: u64,
    /// Length of all of them.
    pub(crate) blind_ns: i64,
}

/// Propagates from `from_ns` to `to_ns` (IMU stamps) through `readings`.
///
/// Where there are none the motion goes on as is the rig's `habit`.
pub(crate) fn propagate(
    state: &mut State,
    covariance: &mut Covariance,
    readings: &[Reading],
    (from_ns, to_ns): (i64, i64),
    habit: &Habit,
    noise: &Noise,
    trace: &mut Vec<TracePoint>,
) -> Bridged {
    trace.clear();
    let mut way = Way { state, covariance, noise, trace, now_ns: from_ns, bridged: Bridged::default() };
    if let Some(first) = readings.first() {
        way.go_blindly(None, Some(first), first.stamp_ns.min(to_ns), habit);
    }
    for pair in readings.windows(2) {
        let [a, b] = pair else { continue };
        if b.stamp_ns <= way.now_ns {
            continue;
        }
        if a.stamp_ns >= to_ns {
            break;
        }
        let end_ns = b.stamp_ns.min(to_ns);
        let apart_s = (b.stamp_ns - a.stamp_ns) as f64 * 1e-9;
        if apart_s > INTERPOLATED_S {
            way.go_blindly(Some(a), Some(b), end_ns, habit);
            continue;
        }
        let (from, to) = (between(a, b, way.now_ns), between(a, b, end_ns));
        way.advance(&from, &to);
        if apart_s > GAP_S {
            way.hide((end_ns - from.stamp_ns) as f64 * 1e-9, &from);
        }
    }
    let last = readings.last();
    // A clock offset asks for a little more than there is: the last reading holds on for so long.
    if let Some(last) = last
        && way.now_ns < to_ns
        && to_ns - last.stamp_ns <= HOLD_NS
    {
        let (from, to) = (Reading { stamp_ns: way.now_ns, ..*last }, Reading { stamp_ns: to_ns, ..*last });
        way.advance(&from, &to);
    }
    way.go_blindly(last, None, to_ns, habit);
    way.bridged
}

/// A propagation on its way.
struct Way<'a> {
    state: &'a mut State,
    covariance: &'a mut Covariance,
    noise: &'a Noise,
    trace: &'a mut Vec<TracePoint>,
    now_ns: i64,
    bridged: Bridged,
}

impl Way<'_> {
    /// One step from reading to reading.
    fn advance(&mut self, a: &Reading, b: &Reading) {
        let h = (b.stamp_ns - a.stamp_ns) as f64 * 1e-9;
        if h <= 0.0 {
            return;
        }
        if self.trace.len() < self.trace.capacity() {
            let rate = if a.held { Vector3::zeros() } else { self.state.rate_of(&a.gyro) };
            self.trace.push(TracePoint { stamp_ns: a.stamp_ns, state: *self.state, rate });
        }
        step(self.state, self.covariance, a, b, h, self.noise);
        self.now_ns = b.stamp_ns;
    }

    /// Adds what a short gap of `h` seconds from reading `a` on hides.
    fn hide(&mut self, h: f64, a: &Reading) {
        self.bridged.gaps += 1;
        self.bridged.blind_ns += (h * 1e9) as i64;
        add_variance(self.covariance, at::ROTATION, (HIDDEN_RATE.max(a.gyro.norm()) * h).powi(2) / 12.0);
        add_variance(self.covariance, at::VELOCITY, (HIDDEN_ACCEL * h).powi(2) / 12.0);
        add_variance(self.covariance, at::POSITION, (HIDDEN_ACCEL * h * h).powi(2) / 48.0);
    }

    /// Goes on to `to_ns` without readings between `before` and `after`.
    fn go_blindly(&mut self, before: Option<&Reading>, after: Option<&Reading>, to_ns: i64, habit: &Habit) {
        let length_ns = to_ns - self.now_ns;
        if length_ns <= 0 {
            return;
        }
        self.bridged.gaps += 1;
        self.bridged.blind_ns += length_ns;
        let kept = |reading: &Reading, stamp_ns: i64| {
            (-(reading.stamp_ns - stamp_ns).abs() as f64 * 1e-9 / RATE_MEMORY_S).exp()
        };
        while self.now_ns < to_ns {
            let end_ns = to_ns.min(self.now_ns + PIECE_NS);
            let middle_ns = self.now_ns + (end_ns - self.now_ns) / 2;
            let sides = [before, after].into_iter().flatten();
            let rate = if before.is_none() && after.is_none() {
                habit.rate / 2.0
            } else {
                sides.map(|side| self.state.rate_of(&side.gyro) * kept(side, middle_ns)).sum()
            };
            if self.trace.len() < self.trace.capacity() {
                self.trace.push(TracePoint { stamp_ns: self.now_ns, state: *self.state, rate });
            }
            let h = (end_ns - self.now_ns) as f64 * 1e-9;
            blind_step(self.state, self.covariance, &rate, h, habit, self.noise);
            self.now_ns = end_ns;
        }
    }
}

/// One step of `h` seconds without readings: turns at `rate`, and the velocity goes back to its mean. What carries the state on says nothing about
/// gravity and sensors, so no errors of these come in.
fn blind_step(
    state: &mut State,
    covariance: &mut Covariance,
    rate: &Vector3<f64>,
    h: f64,
    habit: &Habit,
    noise: &Noise,
) {
    let turn = exp_so3(&(rate * h));
    let kept = (-h / SWING_S).exp();
    let mut change = SMatrix::<f64, MOVING, OWN>::identity();
    let mut set = |row: usize, column: usize, block: &Matrix3<f64>| {
        change.fixed_view_mut::<3, 3>(row, column).copy_from(block);
    };
    set(at::ROTATION, at::ROTATION, turn.inverse().to_rotation_matrix().matrix());
    set(at::POSITION, at::VELOCITY, &(Matrix3::identity() * h));
    set(at::VELOCITY, at::VELOCITY, &(Matrix3::identity() * kept));
    transform(covariance, &change);
    let mut block = covariance.fixed_view_mut::<3, 3>(at::ROTATION, at::ROTATION);
    block += Matrix3::identity() * (BLIND_ROTATION * h) + habit.turning * (2.0 * RATE_MEMORY_S * h);
    let mut block = covariance.fixed_view_mut::<3, 3>(at::VELOCITY, at::VELOCITY);
    block += habit.scatter() * (1.0 - kept * kept);
    add_walks(covariance, h, noise);

    state.position += state.velocity * h;
    state.velocity = habit.velocity + (state.velocity - habit.velocity) * kept;
    state.rotation *= turn;
    state.rotation.renormalize();
}

/// Applies the rows of a transition matrix that are not those of the identity.
fn transform(covariance: &mut Covariance, change: &SMatrix<f64, MOVING, OWN>) {
    let moved: SMatrix<f64, MOVING, DIM> = change * covariance.fixed_rows::<OWN>(0);
    covariance.fixed_view_mut::<MOVING, DIM>(0, 0).copy_from(&moved);
    covariance.fixed_view_mut::<DIM, MOVING>(0, 0).copy_from(&moved.transpose());
    covariance
        .fixed_view_mut::<MOVING, MOVING>(0, 0)
        .copy_from(&(moved.fixed_columns::<OWN>(0) * change.transpose()));
}

/// Adds what biases and the time offset walk in `h` seconds.
fn add_walks(covariance: &mut Covariance, h: f64, noise: &Noise) {
    add_variance(covariance, at::GYRO_BIAS, noise.gyro_walk.powi(2) * h);
    add_variance(covariance, at::ACCEL_BIAS, noise.accel_walk.powi(2) * h);
    covariance[(at::TIME_OFFSET, at::TIME_OFFSET)] += noise.offset_walk.powi(2) * h;
}

/// One trapezoid step of `h` seconds between two readings.
fn step(state: &mut State, covariance: &mut Covariance, a: &Reading, b: &Reading, h: f64, noise: &Noise) {
    let held = a.held && b.held;
    let rate = if held { Vector3::zeros() } else { state.rate_of(&((a.gyro + b.gyro) / 2.0)) };
    let turn = exp_so3(&(rate * h));
    let rotation = state.rotation;
    let mut next = rotation * turn;
    next.renormalize();
    let (force_a, force_b) = (state.force_of(&a.accel), state.force_of(&b.accel));
    let accel = (rotation * force_a + next * force_b) / 2.0 + state.gravity;

    // Only the moving part changes: `change` holds its rows of the transition matrix.
    let mut change = SMatrix::<f64, MOVING, OWN>::identity();
    let mut set = |row: usize, column: usize, block: &Matrix3<f64>| {
        change.fixed_view_mut::<3, 3>(row, column).copy_from(block);
    };
    let r = rotation.to_rotation_matrix();
    let aligned = exp_so3(&state.misalignment).to_rotation_matrix();
    let identity_h = Matrix3::identity() * h;
    set(at::ROTATION, at::ROTATION, turn.inverse().to_rotation_matrix().matrix());
    if !held {
        let unaligned_rate = aligned.inverse_transform_vector(&rate);
        set(at::ROTATION, at::GYRO_BIAS, &(aligned.matrix() * -h));
        set(
            at::ROTATION,
            at::GYRO_SCALE,
            &(aligned.matrix() * Matrix3::from_diagonal(&(unaligned_rate * -h))),
        );
        set(at::ROTATION, at::MISALIGNMENT, &(skew(&rate) * aligned.matrix() * -h));
    }
    let force = (force_a + force_b) / 2.0;
    let by_rotation = -(r.matrix() * skew(&force)) * h;
    let by_bias = -(r.matrix() * aligned.matrix()) * h;
    let by_misalignment = by_rotation * aligned.matrix();
    set(at::VELOCITY, at::ROTATION, &by_rotation);
    set(at::VELOCITY, at::ACCEL_BIAS, &by_bias);
    set(at::VELOCITY, at::MISALIGNMENT, &by_misalignment);
    set(at::VELOCITY, at::GRAVITY, &identity_h);
    set(at::POSITION, at::VELOCITY, &identity_h);
    set(at::POSITION, at::ROTATION, &(by_rotation * (h / 2.0)));
    set(at::POSITION, at::ACCEL_BIAS, &(by_bias * (h / 2.0)));
    set(at::POSITION, at::MISALIGNMENT, &(by_misalignment * (h / 2.0)));
    set(at::POSITION, at::GRAVITY, &(identity_h * (h / 2.0)));
    transform(covariance, &change);

    let gyro_noise = if held { noise.held_gyro } else { noise.gyro };
    add_variance(covariance, at::ROTATION, gyro_noise.powi(2) * NOISE_PERIOD_S * h);
    add_variance(covariance, at::VELOCITY, noise.accel.powi(2) * NOISE_PERIOD_S * h);
    add_walks(covariance, h, noise);

    state.position += state.velocity * h + accel * (h * h / 2.0);
    state.velocity += accel * h;
    state.rotation = next;
}

#[cfg(test)]
mod tests;
