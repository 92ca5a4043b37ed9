//! Stages that died or hung, what became of them, and which frames it cost: in the log, and in a file of the domain's folder that
//! `evac status` reads.

use std::path::PathBuf;

use evac_formats::write_for_this_boot;
use evac_ports::Domain;
use serde::{Deserialize, Serialize};

use crate::pulse::Resumption;

/// Incidents that are remembered; older ones are counted only.
const REMEMBERED: usize = 64;

/// One death of an instance that led.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Incident {
    pub(crate) stage: String,
    /// The instance that died.
    pub(crate) epoch: u32,
    pub(crate) cause: String,
    /// Whether a standby took its place; otherwise it was started again.
    pub(crate) standby: bool,
    /// The last frame that it put out.
    pub(crate) last_seq: Option<u64>,
    /// How the next instance went on: its first new frame, and how long after the death it came, milliseconds.
    pub(crate) resumed: Option<Resumed>,
    /// Host monotonic time of the death.
    pub(crate) died_ns: i64,
}

/// How a stage went on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Resumed {
    pub(crate) seq: u64,
    pub(crate) after_ms: f64,
    /// Frames that the dead instance had put out and the next one put out once more.
    pub(crate) repeated: u64,
    /// First and last of the frames that nobody put out.
    pub(crate) missing: Vec<(u64, u64)>,
}

impl Incident {
    pub(crate) fn new(stage: &str, epoch: u32, cause: String, standby: bool, last_seq: Option<u64>) -> Self {
        let died_ns = evac_ports::now_ns();
        Self { stage: stage.to_owned(), epoch, cause, standby, last_seq, resumed: None, died_ns }
    }

    /// The frames that nobody put out, first and last of each gap.
    pub(crate) fn missing(&self) -> &[(u64, u64)] {
        self.resumed.as_ref().map_or(&[], |resumed| &resumed.missing)
    }

    /// What became of it, for people.
    pub(crate) fn outcome(&self) -> String {
        let how = if self.standby { "the standby took over" } else { "started again" };
        let Some(Resumed { seq, after_ms, repeated, missing }) = &self.resumed else {
            return format!("{how}; no new frame yet");
        };
        let repeated = match repeated {
            0 => String::new(),
            1 => "one frame was put out twice; ".to_owned(),
            many => format!("{many} frames were put out twice; "),
        };
        let gap = |(first, last): &(u64, u64)| {
            if first == last { first.to_string() } else { format!("{first} to {last}") }
        };
        let gaps: Vec<_> = missing.iter().map(gap).collect();
        let count: u64 = missing.iter().map(|(first, last)| last - first + 1).sum();
        let lost = match count {
            0 => "no frame is missing".to_owned(),
            1 => format!("frame {} is missing", gaps.join(" and ")),
            _ => format!("frames {} are missing ({count})", gaps.join(" and ")),
        };
        format!("{how}, next frame {seq} after {after_ms:.0} ms; {repeated}{lost}")
    }
}

/// All incidents of a run.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Incidents {
    /// All there were.
    pub(crate) count: u64,
    /// The newest, newest last.
    pub(crate) newest: Vec<Incident>,
    #[serde(skip)]
    file: Option<PathBuf>,
}

impl Incidents {
    pub(crate) fn of(domain: &Domain) -> Self {
        Self { file: Some(path(domain)), ..Self::default() }
    }

    /// What the launcher of a domain has written.
    pub(crate) fn read(domain: &Domain) -> Self {
        std::fs::read_to_string(path(domain))
            .ok()
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default()
    }

    pub(crate) fn add(&mut self, incident: Incident) {
        self.count += 1;
        if self.newest.len() == REMEMBERED {
            self.newest.remove(0);
        }
        self.newest.push(incident);
        self.write();
    }

    /// The newest one of a stage that is not through.
    pub(crate) fn open(&self, stage: &str) -> bool {
        self.newest
            .iter()
            .rev()
            .find(|incident| incident.stage == stage)
            .is_some_and(|incident| incident.resumed.is_none())
    }

    /// A stage has gone on.
    pub(crate) fn resumed(&mut self, stage: &str, Resumption { first, repeated, missing }: Resumption) {
        let Some(first) = first else { return };
        let open = self
            .newest
            .iter_mut()
            .rev()
            .find(|incident| incident.stage == stage && incident.resumed.is_none());
        let Some(incident) = open else { return };
        let after_ms = (first.sent_ns - incident.died_ns) as f64 * 1e-6;
        incident.resumed = Some(Resumed { seq: first.seq, after_ms, repeated, missing });
        tracing::warn!(stage, "{}", incident.outcome());
        self.write();
    }

    pub(crate) fn of_stage<'a>(&'a self, stage: &'a str) -> impl DoubleEndedIterator<Item = &'a Incident> {
        self.newest.iter().filter(move |incident| incident.stage == stage)
    }

    fn write(&self) {
        let Some(file) = &self.file else { return };
        let written = serde_json::to_vec(self).map_err(|cause| cause.to_string()).and_then(|json| {
            write_for_this_boot(file, |writer| std::io::Write::write_all(writer, &json))
                .map_err(|cause| cause.to_string())
        });
        // It is in the log; a full disk is no reason to stop.
        if let Err(cause) = written {
            tracing::warn!(cause, "the incident is not in the status");
        }
    }
}

fn path(domain: &Domain) -> PathBuf {
    domain.folder().join("incidents.json")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::Beat;

    #[test]
    fn an_incident_says_exactly_which_frames_it_cost() {
        let mut incidents = Incidents::default();
        incidents.add(Incident::new("lio", 0, "killed".to_owned(), false, Some(41)));
        assert!(incidents.newest[0].outcome().contains("no new frame yet"));
        let went_on = |seq: u64, sent_ns: i64, repeated: u64, missing: &[(u64, u64)]| Resumption {
            first: Some(Beat { seq, sent_ns }),
            repeated,
            missing: missing.to_vec(),
        };
        let after = incidents.newest[0].died_ns + 250_000_000;
        incidents.resumed("lio", went_on(45, after, 0, &[(42, 44)]));
        let outcome = incidents.newest[0].outcome();
        assert!(
            outcome.contains("after 250 ms") && outcome.contains("frames 42 to 44 are missing (3)"),
            "{outcome}"
        );
        incidents.add(Incident::new("lio", 1, "killed".to_owned(), true, Some(60)));
        incidents.resumed("lio", went_on(61, 0, 0, &[]));
        let outcome = incidents.newest[1].outcome();
        assert!(outcome.contains("standby") && outcome.contains("; no frame is missing"), "{outcome}");
        assert!(!outcome.contains("twice"), "{outcome}");
        // A sink that says first what the dead one had written down.
        incidents.add(Incident::new("saver", 0, "killed".to_owned(), false, Some(60)));
        incidents.resumed("saver", went_on(61, 0, 2, &[(62, 70), (72, 72)]));
        let outcome = incidents.newest[2].outcome();
        assert!(
            outcome.contains("2 frames were put out twice; frames 62 to 70 and 72 are missing (10)"),
            "{outcome}"
        );
    }
}
