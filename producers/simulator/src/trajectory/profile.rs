//! Starting, cruising and stopping without a jump in velocity, acceleration or jerk.

use super::jet::Jet;

/// The quintic smooth step 10 u^3 - 15 u^4 + 6 u^5 on [0, 1] and its first and second derivative; its value,
/// slope and curvature are those of 0 before and of 1 after.
pub(super) fn smooth_step(u: f64) -> [f64; 3] {
    if u <= 0.0 {
        return [0.0; 3];
    }
    if u >= 1.0 {
        return [1.0, 0.0, 0.0];
    }
    [
        u * u * u * (10.0 + u * (6.0 * u - 15.0)),
        30.0 * u * u * (1.0 - u) * (1.0 - u),
        60.0 * u * (1.0 - u) * (1.0 - 2.0 * u),
    ]
}

/// Largest slope of the smooth step, at its middle.
pub(super) const SMOOTH_STEP_PEAK: f64 = 1.875;

/// A way of `length` covered with smooth starts and stops of `ramp` each and constant `speed` between them.
/// "Time" is seconds for a walk and metres along the leg for the height of a stair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile {
    ramp: f64,
    speed: f64,
    duration: f64,
}

impl Profile {
    /// Covers `length` at `speed` (slower where the way is too short for two ramps).
    pub(super) fn at_speed(length: f64, speed: f64, ramp: f64) -> Self {
        let speed = speed.min(length / ramp);
        Self { ramp, speed, duration: length / speed + ramp }
    }

    /// Covers `length` in `duration`, of which the two ramps take `ramp` each.
    pub(super) fn in_duration(length: f64, duration: f64, ramp: f64) -> Self {
        Self { ramp, speed: length / (duration - ramp), duration }
    }

    pub(super) fn duration(&self) -> f64 {
        self.duration
    }

    /// Way covered at `t`, and its first and second derivative.
    pub(super) fn way(&self, t: f64) -> [f64; 3] {
        let length = self.speed * (self.duration - self.ramp);
        if t > 0.5 * self.duration {
            let [way, speed, acceleration] = self.first_half(self.duration - t);
            return [length - way, speed, -acceleration];
        }
        self.first_half(t)
    }

    /// Share of the cruising speed at `t`, with two derivatives: the envelope of the gait.
    pub(super) fn share_of_speed(&self, t: f64) -> Jet {
        let (t, sign) = if t > 0.5 * self.duration { (self.duration - t, -1.0) } else { (t, 1.0) };
        Jet { x: t / self.ramp, v: sign / self.ramp, a: 0.0 }.through(smooth_step(t / self.ramp))
    }

    fn first_half(&self, t: f64) -> [f64; 3] {
        let u = (t / self.ramp).max(0.0);
        if u >= 1.0 {
            return [self.speed * (t - 0.5 * self.ramp), self.speed, 0.0];
        }
        let [share, slope, _] = smooth_step(u);
        // Integral of the smooth step: u^4 (5/2 - 3 u + u^2).
        let way = u * u * u * u * (2.5 - 3.0 * u + u * u);
        [self.speed * self.ramp * way, self.speed * share, self.speed / self.ramp * slope]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_is_covered_whole_and_its_derivatives_are_those_of_the_way() {
        for profile in [Profile::at_speed(10.0, 1.1, 1.2), Profile::at_speed(0.5, 1.1, 1.2)] {
            let end = profile.way(profile.duration());
            assert!((end[0] - if profile.speed < 1.0 { 0.5 } else { 10.0 }).abs() < 1e-12);
            assert_eq!(&end[1..], &[0.0, 0.0]);
            let h = 1e-5;
            for k in 1..100 {
                let t = profile.duration() * f64::from(k) / 100.0;
                let [way, speed, acceleration] = profile.way(t);
                let (before, after) = (profile.way(t - h), profile.way(t + h));
                assert!(((after[0] - before[0]) / (2.0 * h) - speed).abs() < 1e-6, "at {t}, {way} m");
                assert!(((after[1] - before[1]) / (2.0 * h) - acceleration).abs() < 1e-6, "at {t}");
            }
        }
    }
}
