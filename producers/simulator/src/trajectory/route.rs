//! A route as one would tell it to a walker: stand, walk there, climb there, turn, stand.

use evac_geometry::nalgebra::Vector3;

use super::profile::{Profile, SMOOTH_STEP_PEAK};

/// Time a walker takes to come to full speed, seconds; also to stop.
const START_S: f64 = 1.2;
/// Way over which the slope of a stair sets in, metres.
const SLOPE_ONSET_M: f64 = 0.5;
/// Places that differ by less need no way.
const SAME_PLACE_M: f64 = 1e-6;
/// Headings that differ by less need no turn, rad: a turn left out is a jump that no gyroscope sees.
const SAME_HEADING: f64 = 1e-4;

/// Height gained on a leg.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rise {
    /// Way from the leg's start to where the stair begins, metres.
    pub(super) from: f64,
    /// Height over way from there.
    pub(super) profile: Profile,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Stand,
    Walk { profile: Profile, rise: Option<Rise> },
    Turn { angle: f64 },
}

/// One thing the walker does; position and heading are those at its start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Move {
    pub(super) start_s: f64,
    pub(super) duration_s: f64,
    pub(super) position: Vector3<f64>,
    pub(super) heading: f64,
    pub(super) kind: Kind,
}

/// Builder of a list of moves.
#[derive(Debug, Clone)]
pub(crate) struct Route {
    pub(super) moves: Vec<Move>,
    time: f64,
    position: Vector3<f64>,
    heading: f64,
    speed: f64,
    turn_rate: f64,
}

impl Route {
    /// Starts at a place on the floor with a heading in degrees (counterclockwise from x).
    pub(crate) fn start(position: [f64; 3], heading_deg: f64, speed_m_s: f64, turn_rate_dps: f64) -> Self {
        Self {
            moves: Vec::new(),
            time: 0.0,
            position: position.into(),
            heading: heading_deg.to_radians(),
            speed: speed_m_s,
            turn_rate: turn_rate_dps.to_radians(),
        }
    }

    /// Stands exactly still.
    pub(crate) fn stand(self, seconds: f64) -> Self {
        self.push(seconds, Kind::Stand)
    }

    /// Turns on the spot to the new direction where needed, then walks straight.
    pub(crate) fn walk_to(self, x: f64, y: f64) -> Self {
        self.leg(x, y, None)
    }

    /// As [`Self::walk_to`], with a stair of height `rise` from `from` to `to` metres along the leg.
    pub(crate) fn climb_to(self, x: f64, y: f64, [from, to]: [f64; 2], rise: f64) -> Self {
        let profile = Profile::in_duration(rise, to - from, SLOPE_ONSET_M);
        self.leg(x, y, Some(Rise { from, profile }))
    }

    /// Turns on the spot, left by positive degrees.
    pub(crate) fn turn(self, degrees: f64) -> Self {
        self.turn_by(degrees.to_radians())
    }

    /// The whole way `laps` times, each time straight back to the start and its heading.
    pub(crate) fn laps(self, laps: u32) -> Self {
        let Some(start) = self.moves.first().copied().filter(|_| laps > 1) else { return self };
        let apart = (self.position.xy() - start.position.xy()).norm();
        let mut route =
            if apart > SAME_PLACE_M { self.walk_to(start.position.x, start.position.y) } else { self };
        let turned = start.heading - route.heading;
        let angle = turned - std::f64::consts::TAU * (turned / std::f64::consts::TAU).round();
        if angle.abs() > SAME_HEADING {
            route = route.turn_by(angle);
        }
        let (lap, lap_s) = (route.moves.clone(), route.time);
        for number in 1..laps {
            let later_s = f64::from(number) * lap_s;
            route.moves.extend(lap.iter().map(|next| Move { start_s: next.start_s + later_s, ..*next }));
        }
        route.time = f64::from(laps) * lap_s;
        route
    }

    /// Seconds until the walker is in mid-stride for the first time.
    pub(crate) fn stride_s(&self) -> f64 {
        let first = self.moves.iter().find(|next| matches!(next.kind, Kind::Walk { .. }));
        first.map_or(0.0, |walk| walk.start_s + (START_S + 0.3).min(walk.duration_s / 2.0))
    }

    fn leg(self, x: f64, y: f64, rise: Option<Rise>) -> Self {
        let (dx, dy) = (x - self.position.x, y - self.position.y);
        let wanted = dy.atan2(dx) - self.heading;
        // The turn on the spot in (-pi, pi], half turns to the left.
        let angle = std::f64::consts::PI - (std::f64::consts::PI - wanted).rem_euclid(std::f64::consts::TAU);
        let turned = if angle.abs() > SAME_HEADING { self.turn_by(angle) } else { self };
        let profile = Profile::at_speed(dx.hypot(dy), turned.speed, START_S);
        let mut next = turned.push(profile.duration(), Kind::Walk { profile, rise });
        let gained = rise.map_or(0.0, |rise| rise.profile.way(rise.profile.duration())[0]);
        next.position = Vector3::new(x, y, next.position.z + gained);
        next.heading = dy.atan2(dx);
        if let Some(last) = next.moves.last_mut() {
            last.heading = next.heading;
        }
        next
    }

    fn turn_by(self, angle: f64) -> Self {
        let duration = (SMOOTH_STEP_PEAK * angle.abs() / self.turn_rate).max(0.5);
        let mut next = self.push(duration, Kind::Turn { angle });
        next.heading += angle;
        next
    }

    fn push(mut self, duration_s: f64, kind: Kind) -> Self {
        let (position, heading) = (self.position, self.heading);
        self.moves.push(Move { start_s: self.time, duration_s, position, heading, kind });
        self.time += duration_s;
        self
    }
}
