//! Everything that is known of a running pipeline at one moment: the stages' reports, the launcher's word, and the kernel's.

use std::collections::BTreeMap;

use evac_frames::{Health, LatencySummary};
use evac_ports::{Bus, Domain, Listener};
use serde_json::{Map, Value, json};

use crate::control::{StageWord, stages};
use crate::error::LaunchError;
use crate::health_board::{HealthBoard, as_json, summary_json};
use crate::incidents::Incidents;
use crate::status::nothing_runs;
use crate::usage::{Usage, Usages};

/// Looks at a running pipeline again and again.
#[derive(Debug)]
pub(crate) struct Watcher {
    domain: Domain,
    board: HealthBoard,
    usages: Usages,
    /// Dropped last.
    pub(crate) bus: Bus,
}

/// A running pipeline.
#[derive(Debug)]
pub(crate) struct View {
    pub(crate) domain: String,
    pub(crate) launcher: u32,
    /// In the pipeline's order.
    pub(crate) stages: Vec<StageView>,
    /// Stages that died or hung.
    pub(crate) incidents: Incidents,
}

/// A stage and its instances.
#[derive(Debug)]
pub(crate) struct StageView {
    pub(crate) name: String,
    /// Nothing where the launcher does not answer.
    pub(crate) word: Option<StageWord>,
    /// The routed one first.
    pub(crate) instances: Vec<InstanceView>,
}

/// A process of a stage.
#[derive(Debug)]
pub(crate) struct InstanceView {
    pub(crate) health: Health,
    /// Nothing once it has ended.
    pub(crate) usage: Option<Usage>,
}

impl Watcher {
    /// Joins the domain; the listener wakes when a stage reports.
    pub(crate) fn open(domain: &Domain, name: &str) -> Result<(Self, Listener), LaunchError> {
        domain.holder().ok_or_else(|| nothing_runs(domain))?;
        let bus = Bus::join(domain, name)?;
        let (board, listener) = HealthBoard::open(&bus)?;
        Ok((Self { domain: domain.clone(), board, usages: Usages::default(), bus }, listener))
    }

    /// Takes the reports that have come.
    pub(crate) fn take_in(&mut self) -> Result<(), LaunchError> {
        Ok(self.board.take_in()?)
    }

    /// The pipeline as it is now; an error when it has ended.
    pub(crate) fn look(&mut self) -> Result<View, LaunchError> {
        let launcher = self.domain.holder().ok_or_else(|| nothing_runs(&self.domain))?;
        self.take_in()?;
        let words: BTreeMap<String, (usize, StageWord)> = stages(&self.domain)
            .into_iter()
            .enumerate()
            .map(|(place, word)| (word.name.clone(), (place, word)))
            .collect();
        for (_, word) in words.values() {
            self.board.lead(&word.name, word.epoch);
        }
        let mut stages = Vec::new();
        for (name, leader) in self.board.all() {
            let (place, word) =
                words.get(name).cloned().map_or((usize::MAX, None), |(place, word)| (place, Some(word)));
            let others = self.board.instances(name).filter(|other| {
                // One that is gone has been heard of all the same.
                let lives =
                    |word: &StageWord| word.instances.iter().any(|instance| instance.epoch == other.epoch);
                other.epoch != leader.epoch && word.as_ref().is_none_or(lives)
            });
            let instances: Vec<_> = std::iter::once(leader)
                .chain(others)
                .map(|health| InstanceView { health: *health, usage: self.usages.of(health.pid) })
                .collect();
            stages.push((place, StageView { name: name.to_owned(), word, instances }));
        }
        stages.sort_by_key(|(place, _)| *place);
        let stages = stages.into_iter().map(|(_, stage)| stage).collect();
        let incidents = Incidents::read(&self.domain);
        Ok(View { domain: self.domain.name().to_owned(), launcher, stages, incidents })
    }
}

impl View {
    /// For `evac status --json`.
    pub(crate) fn as_json(&self) -> Value {
        let stages: Map<String, Value> =
            self.stages.iter().map(|stage| (stage.name.clone(), self.stage_as_json(stage))).collect();
        let order: Vec<_> = self.stages.iter().map(|stage| &stage.name).collect();
        let [pose, plan] = self.sensor_to().map(|latency| latency.as_ref().map(summary_json));
        json!({
            "domain": self.domain,
            "launcher_pid": self.launcher,
            "order": order,
            "sensor_to": { "pose": pose, "plan": plan },
            "stages": stages,
            "incidents": self.incidents.newest,
        })
    }

    fn stage_as_json(&self, stage: &StageView) -> Value {
        let mut json = stage.as_json();
        json["deaths"] = self.incidents.of_stage(&stage.name).count().into();
        json
    }

    /// Latencies from a scan's last byte to its pose and to the plan with it.
    pub(crate) fn sensor_to(&self) -> [Option<LatencySummary>; 2] {
        ["odometry/pose", "grid/plan"].map(|service| {
            let writes = |word: &StageWord| word.writes.as_deref() == Some(service);
            let stage = self.stages.iter().find(|stage| stage.word.as_ref().is_some_and(writes))?;
            stage.instances.first().map(|leader| leader.health.end_to_end)
        })
    }
}

impl StageView {
    /// The instance that leads, with what concerns the stage, and beside it those that do not lead.
    fn as_json(&self) -> Value {
        let mut instances = self.instances.iter().map(InstanceView::as_json);
        let mut json = instances.next().unwrap_or_default();
        json["standbys"] = instances.collect();
        json["route"] = self.word.as_ref().map_or(
            Value::Null,
            |word| json!({ "epoch": word.epoch, "from_seq": word.from_seq, "service": word.writes }),
        );
        json["kind"] = json!(self.word.as_ref().map(|word| &word.kind));
        json["role"] = json!(self.word.as_ref().map(|word| &word.role));
        json["restarts"] = json!(self.word.as_ref().map(|word| word.restarts));
        json
    }
}

impl InstanceView {
    fn as_json(&self) -> Value {
        let mut json = as_json(&self.health);
        json["cpu_percent"] = json!(self.usage.map(|usage| (usage.cpu_percent * 100.0).round() * 0.01));
        json["memory"] = self.usage.map_or(
            Value::Null,
            |usage| json!({ "own_bytes": usage.own_bytes, "shared_bytes": usage.shared_bytes }),
        );
        json
    }
}
