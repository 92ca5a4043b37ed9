//! The newest report of every stage.

use std::collections::BTreeMap;

use evac_frames::{Health, LatencySummary, OdometryHealth, StageState, TrackingState};
use evac_ports::services::HealthStatus;
use evac_ports::{Bus, Listener, PortError, RecordSubscriber, now_ns};
use serde_json::{Value, json};

use crate::device_health::device_json;

/// The newest report of every stage of a domain.
#[derive(Debug)]
pub(crate) struct HealthBoard {
    port: RecordSubscriber<HealthStatus>,
    /// By name and epoch.
    newest: BTreeMap<(String, u32), Health>,
    /// The instance that leads, where it was said.
    leading: BTreeMap<String, u32>,
}

impl HealthBoard {
    pub(crate) fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        let (port, listener) = RecordSubscriber::open(bus)?;
        Ok((Self { port, newest: BTreeMap::new(), leading: BTreeMap::new() }, listener))
    }

    /// Takes all reports that have come.
    pub(crate) fn take_in(&mut self) -> Result<(), PortError> {
        while let Some(health) = self.port.receive()? {
            self.newest.insert((Health::text_of(&health.name), health.epoch), health);
        }
        Ok(())
    }

    /// Of the instance that leads: the one that was named, or else the newest that neither follows nor has handed over.
    pub(crate) fn get(&self, name: &str) -> Option<&Health> {
        if let Some(epoch) = self.leading.get(name) {
            return self.of(name, *epoch);
        }
        let mut instances = self.instances(name).rev();
        instances.clone().find(|health| leads(health)).or_else(|| instances.next())
    }

    pub(crate) fn of(&self, name: &str, epoch: u32) -> Option<&Health> {
        self.newest.get(&(name.to_owned(), epoch))
    }

    /// All instances of a stage, the oldest first.
    pub(crate) fn instances(&self, name: &str) -> impl DoubleEndedIterator<Item = &Health> + Clone {
        self.newest.range((name.to_owned(), 0)..=(name.to_owned(), u32::MAX)).map(|(_, health)| health)
    }

    pub(crate) fn lead(&mut self, name: &str, epoch: u32) {
        self.leading.insert(name.to_owned(), epoch);
    }

    pub(crate) fn forget(&mut self, name: &str, epoch: u32) {
        self.newest.remove(&(name.to_owned(), epoch));
    }

    /// Every stage with the report of the instance that leads.
    pub(crate) fn all(&self) -> impl Iterator<Item = (&str, &Health)> {
        let mut names: Vec<_> = self.newest.keys().map(|(name, _)| name.as_str()).collect();
        names.dedup();
        names.into_iter().filter_map(|name| Some((name, self.get(name)?)))
    }
}

/// Whether an instance processes frames, as far as it says.
pub(crate) fn leads(health: &Health) -> bool {
    let others = [StageState::Following, StageState::Ready, StageState::Retired, StageState::Shadow];
    others.iter().all(|state| *state as u32 != health.state)
}

/// The state in one word.
pub(crate) fn state_word(health: &Health) -> &'static str {
    let state = |state: StageState| state as u32 == health.state;
    if state(StageState::Waiting) {
        "waiting"
    } else if state(StageState::Running) {
        "running"
    } else if state(StageState::Finished) {
        "finished"
    } else if state(StageState::Following) {
        "following"
    } else if state(StageState::Ready) {
        "standby"
    } else if state(StageState::Retired) {
        "retired"
    } else if state(StageState::Shadow) {
        "shadow"
    } else {
        "failed"
    }
}

/// Seconds since the last frame came in.
pub(crate) fn age_s(health: &Health) -> Option<f64> {
    (health.last_input_ns > 0).then(|| (now_ns() - health.last_input_ns) as f64 * 1e-9)
}

/// A report for `status --json` and summary.json.
pub(crate) fn as_json(health: &Health) -> Value {
    json!({
        "pid": health.pid,
        "epoch": health.epoch,
        "state": state_word(health),
        "reason": Health::text_of(&health.reason),
        "frames": frames_json(health),
        "rate_hz": health.rate_millihertz as f64 * 1e-3,
        "age_s": age_s(health),
        "last_seq": health.last_seq,
        "latency": latency_json(health),
        "odometry": odometry_json(health),
        "device": device_json(health),
    })
}

/// How an odometry fares; null for other stages and before the first pose.
pub(crate) fn odometry_json(health: &Health) -> Value {
    let odometry = &health.odometry;
    let Some(state) = tracking_word(odometry) else { return Value::Null };
    let share = |frames: u64| frames as f64 / odometry.poses.max(1) as f64;
    json!({
        "state": state,
        "poses": odometry.poses,
        "degenerate": {
            "frames": odometry.degenerate,
            "share": share(odometry.degenerate),
            "directions_now": odometry.directions,
        },
        "losses": {
            "count": odometry.losses,
            "frames": odometry.lost,
            "lost_now": odometry.state == TrackingState::Lost as u32,
        },
        "quality": (f64::from(odometry.quality) * 1e4).round() * 1e-4,
        "time_offset_ms": odometry.time_offset_ns as f64 * 1e-6,
        "time_offset_sigma_ms": time_offset_sigma_ms(odometry),
        "gyro_bias_rad_s": odometry.gyro_bias,
        "accel_bias_m_s2": odometry.accel_bias,
    })
}

/// The same in a line for people.
pub(crate) fn odometry_line(health: &Health) -> Option<String> {
    let odometry = &health.odometry;
    let state = tracking_word(odometry)?;
    let degenerate = odometry.degenerate as f64 / odometry.poses.max(1) as f64 * 100.0;
    let sigma = time_offset_sigma_ms(odometry).map_or(String::new(), |sigma| format!(" (sigma {sigma:.2})"));
    let three = |values: [f64; 3], scale: f64| values.map(|value| format!("{:+.3}", value * scale)).join(" ");
    Some(format!(
        "{state}; degenerate {degenerate:.0} % of frames, {} directions now; lost {} times, {} frames; quality {:.2}; \
         clock {:+.2} ms{sigma}; bias gyro {} deg/s, accel {} m/s^2",
        odometry.directions,
        odometry.losses,
        odometry.lost,
        odometry.quality,
        odometry.time_offset_ns as f64 * 1e-6,
        three(odometry.gyro_bias, 1_f64.to_degrees()),
        three(odometry.accel_bias, 1.0),
    ))
}

/// The tracking state in one word, once there are poses.
fn tracking_word(odometry: &OdometryHealth) -> Option<&'static str> {
    (odometry.poses > 0).then_some(())?;
    Some(match TrackingState::of(odometry.state)? {
        TrackingState::Initialising => "initialising",
        TrackingState::Tracking => "tracking",
        TrackingState::Degenerate => "degenerate",
        TrackingState::Lost => "lost",
    })
}

/// `None` where the offset is not estimated.
fn time_offset_sigma_ms(odometry: &OdometryHealth) -> Option<f64> {
    (odometry.time_offset_sigma_us > 0).then(|| f64::from(odometry.time_offset_sigma_us) * 1e-3)
}

/// What a stage counted.
pub(crate) fn frames_json(health: &Health) -> Value {
    json!({
        "in": health.frames_in,
        "out": health.frames_out,
        "lost": health.lost,
        "late": health.late,
        "degraded": health.degraded,
        "rejected_points": health.rejected,
        "imu_lost": health.imu_lost,
    })
}

/// Latencies of a stage in milliseconds.
pub(crate) fn latency_json(health: &Health) -> Value {
    json!({
        "ipc": summary_json(&health.ipc),
        "compute": summary_json(&health.compute),
        "end_to_end": summary_json(&health.end_to_end),
    })
}

/// One latency in milliseconds.
pub(crate) fn summary_json(latency: &LatencySummary) -> Value {
    let ms = |ns: u64| (ns as f64 * 1e-3).round() * 1e-3;
    json!({ "count": latency.count, "p50_ms": ms(latency.p50_ns), "p99_ms": ms(latency.p99_ns), "max_ms": ms(latency.max_ns) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn health() -> Health {
        let odometry = OdometryHealth {
            poses: 200,
            degenerate: 50,
            lost: 7,
            losses: 2,
            time_offset_ns: -1_250_000,
            time_offset_sigma_us: 40,
            gyro_bias: [0.01, 0.0, 0.0],
            quality: 0.75,
            directions: 2,
            state: TrackingState::Lost as u32,
            ..OdometryHealth::default()
        };
        Health { odometry, ..Health::default() }
    }

    #[test]
    fn a_lost_odometry_says_so_with_its_counts_shares_clock_and_biases() {
        let json = odometry_json(&health());
        assert_eq!(json["state"], "lost");
        assert_eq!(json["losses"], json!({ "count": 2, "frames": 7, "lost_now": true }));
        assert_eq!(json["degenerate"], json!({ "frames": 50, "share": 0.25, "directions_now": 2 }));
        assert_eq!((&json["quality"], &json["time_offset_ms"]), (&json!(0.75), &json!(-1.25)));
        assert_eq!(json["time_offset_sigma_ms"], 0.04);
        let line = odometry_line(&health()).unwrap();
        for word in [
            "lost; degenerate 25 %",
            "2 directions",
            "lost 2 times, 7 frames",
            "-1.25 ms (sigma 0.04)",
            "+0.573",
        ] {
            assert!(line.contains(word), "no '{word}' in {line}");
        }
    }

    #[test]
    fn a_stage_that_is_no_odometry_says_nothing_of_it_and_an_offset_that_is_not_estimated_has_no_sigma() {
        assert_eq!(odometry_json(&Health::default()), Value::Null);
        assert_eq!(odometry_line(&Health::default()), None);
        let mut loam = health();
        loam.odometry.time_offset_sigma_us = 0;
        assert_eq!(odometry_json(&loam)["time_offset_sigma_ms"], Value::Null);
        assert!(!odometry_line(&loam).unwrap().contains("sigma"));
    }
}
