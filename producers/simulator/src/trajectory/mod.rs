//! Where the walker's IMU is at any time, with velocity, acceleration and angular velocity that belong to it exactly.

mod gait;
mod jet;
mod profile;
mod route;

pub(crate) use gait::Gait;
pub(crate) use route::Route;

use evac_geometry::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use evac_geometry::{STANDARD_GRAVITY, rotation_from_euler};

use gait::Sway;
use jet::Jet;
use profile::{Profile, smooth_step};
use route::{Kind, Move, Rise};

/// Height of the IMU above the floor, metres.
pub(crate) const IMU_HEIGHT: f64 = 1.2;
/// The rig is carried this far in front of the walker's axis of turning, metres.
const CARRIED_AHEAD: f64 = 0.15;

/// State of the IMU at one time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    pub(crate) world_from_imu: Isometry3<f64>,
    /// m/s, world frame.
    pub(crate) velocity: Vector3<f64>,
    /// m/s^2, world frame.
    pub(crate) acceleration: Vector3<f64>,
    /// rad/s, IMU frame.
    pub(crate) angular_velocity: Vector3<f64>,
}

impl Motion {
    /// What an ideal accelerometer measures, m/s^2, IMU frame: at rest 9.80665 upwards.
    pub(crate) fn specific_force(&self) -> Vector3<f64> {
        self.world_from_imu.rotation.inverse() * (self.acceleration + Vector3::z() * STANDARD_GRAVITY)
    }
}

/// The whole walk as a function of time.
#[derive(Debug, Clone)]
pub(crate) struct Trajectory {
    moves: Vec<Move>,
    gait: Gait,
    tilt: [f64; 2],
    skipped_s: f64,
}

impl Trajectory {
    /// A route walked with a gait by an IMU that is mounted with a constant roll and pitch (radians).
    pub(crate) fn new(route: Route, gait: Gait, tilt: [f64; 2]) -> Self {
        Self { moves: route.moves, gait, tilt, skipped_s: 0.0 }
    }

    /// The same walk from `seconds` after its start on; what was then is now time 0.
    pub(crate) fn without_first(self, seconds: f64) -> Self {
        Self { skipped_s: seconds, ..self }
    }

    /// Seconds until the walker has stopped for good.
    pub(crate) fn duration_s(&self) -> f64 {
        self.moves.last().map_or(0.0, |last| last.start_s + last.duration_s - self.skipped_s)
    }

    /// The state at `t` seconds; before the start and after the end the walker stands.
    pub(crate) fn at(&self, t: f64) -> Motion {
        let t = t.clamp(0.0, self.duration_s()) + self.skipped_s;
        let after = self.moves.partition_point(|next| next.start_s <= t);
        let Some(current) = self.moves.get(after.saturating_sub(1)) else {
            return self.motion(&Stance::default(), &Sway::default());
        };
        let stance = Stance::of(current, t - current.start_s);
        self.motion(&stance, &self.gait.at(t, stance.walking, stance.turning))
    }

    fn motion(&self, stance: &Stance, sway: &Sway) -> Motion {
        let roll = sway.roll + Jet::constant(self.tilt[0]);
        let pitch = sway.pitch + Jet::constant(self.tilt[1]);
        let yaw = stance.heading + sway.yaw;

        let (sin, cos) = (stance.heading.sin(), stance.heading.cos());
        let x = stance.position[0] + cos * CARRIED_AHEAD + sin * sway.left * -1.0;
        let y = stance.position[1] + sin * CARRIED_AHEAD + cos * sway.left;
        let z = stance.position[2] + Jet::constant(IMU_HEIGHT) + sway.up;

        // Rates of R = Rz(yaw) Ry(pitch) Rx(roll) in the body frame.
        let (sin_roll, cos_roll) = roll.x.sin_cos();
        let (sin_pitch, cos_pitch) = pitch.x.sin_cos();
        let angular_velocity = Vector3::new(
            roll.v - yaw.v * sin_pitch,
            pitch.v * cos_roll + yaw.v * sin_roll * cos_pitch,
            -pitch.v * sin_roll + yaw.v * cos_roll * cos_pitch,
        );
        let rotation = UnitQuaternion::from_rotation_matrix(&rotation_from_euler(roll.x, pitch.x, yaw.x));
        Motion {
            world_from_imu: Isometry3::from_parts(Translation3::new(x.x, y.x, z.x), rotation),
            velocity: Vector3::new(x.v, y.v, z.v),
            acceleration: Vector3::new(x.a, y.a, z.a),
            angular_velocity,
        }
    }
}

/// Where the walker's feet are and how much they move.
#[derive(Default)]
struct Stance {
    position: [Jet; 3],
    heading: Jet,
    /// Share of walking speed.
    walking: Jet,
    /// Share of turning speed.
    turning: Jet,
}

impl Stance {
    fn of(current: &Move, t: f64) -> Self {
        let standing = Self {
            position: [current.position.x, current.position.y, current.position.z].map(Jet::constant),
            heading: Jet::constant(current.heading),
            ..Self::default()
        };
        match current.kind {
            Kind::Stand => standing,
            Kind::Turn { angle } => {
                let clock = Jet { x: t / current.duration_s, v: 1.0 / current.duration_s, a: 0.0 };
                // Feet start after the turn has and rest before it ends.
                let rise = Jet { x: 3.0 * clock.x, v: 3.0 * clock.v, a: 0.0 };
                let fall = Jet { x: 3.0 * (1.0 - clock.x), v: -3.0 * clock.v, a: 0.0 };
                let turning = rise.through(smooth_step(rise.x)) * fall.through(smooth_step(fall.x));
                let heading = standing.heading + clock.through(smooth_step(clock.x)) * angle;
                Self { heading, turning, ..standing }
            }
            Kind::Walk { profile, rise } => Self::walking(standing, current.heading, t, &profile, rise),
        }
    }

    fn walking(standing: Self, heading: f64, t: f64, profile: &Profile, rise: Option<Rise>) -> Self {
        let [x, v, a] = profile.way(t);
        let way = Jet { x, v, a };
        let (sin, cos) = heading.sin_cos();
        let [x0, y0, z0] = standing.position;
        let climbed = rise.map_or(Jet::default(), |rise| {
            let along = (way.x - rise.from).clamp(0.0, rise.profile.duration());
            way.through(rise.profile.way(along))
        });
        Self {
            position: [x0 + way * cos, y0 + way * sin, z0 + climbed],
            walking: profile.share_of_speed(t),
            ..standing
        }
    }
}

#[cfg(test)]
mod tests;
