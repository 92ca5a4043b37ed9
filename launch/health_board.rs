//! The newest report of every stage.

use std::collections::BTreeMap;

use evac_frames::{Health, LatencySummary, StageState};
use evac_ports::services::HealthStatus;
use evac_ports::{Bus, Listener, PortError, RecordSubscriber, now_ns};
use serde_json::{Value, json};

/// The newest report of every stage of a domain.
#[derive(Debug)]
pub(crate) struct HealthBoard {
    port: RecordSubscriber<HealthStatus>,
    newest: BTreeMap<String, Health>,
}

impl HealthBoard {
    pub(crate) fn open(bus: &Bus) -> Result<(Self, Listener), PortError> {
        let (port, listener) = RecordSubscriber::open(bus)?;
        Ok((Self { port, newest: BTreeMap::new() }, listener))
    }

    /// Takes all reports that have come.
    pub(crate) fn take_in(&mut self) -> Result<(), PortError> {
        while let Some(health) = self.port.receive()? {
            self.newest.insert(Health::text_of(&health.name), health);
        }
        Ok(())
    }

    pub(crate) fn get(&self, name: &str) -> Option<&Health> {
        self.newest.get(name)
    }

    pub(crate) fn all(&self) -> impl Iterator<Item = (&str, &Health)> {
        self.newest.iter().map(|(name, health)| (name.as_str(), health))
    }
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
    })
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
    let summary = |latency: &LatencySummary| {
        let ms = |ns: u64| (ns as f64 * 1e-3).round() * 1e-3;
        json!({ "count": latency.count, "p50_ms": ms(latency.p50_ns), "p99_ms": ms(latency.p99_ns), "max_ms": ms(latency.max_ns) })
    };
    json!({
        "ipc": summary(&health.ipc),
        "compute": summary(&health.compute),
        "end_to_end": summary(&health.end_to_end),
    })
}
