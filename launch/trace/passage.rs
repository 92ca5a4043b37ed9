//! A frame's way through the stages, in numbers and as text.

use std::fmt::Write as _;

use evac_frames::{Health, Trace};
use serde_json::{Value, json};

/// Characters of a bar.
const BAR: usize = 48;

/// A frame's way through the stages.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Passage {
    pub(crate) seq: u64,
    /// In the pipeline's order.
    pub(crate) hops: Vec<Hop>,
    /// Stages that did not speak of the frame.
    pub(crate) silent: Vec<String>,
}

/// A frame in one stage; all times in milliseconds after the scan's last byte had come in.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hop {
    pub(crate) stage: String,
    pub(crate) epoch: u32,
    /// The stage before handed it over.
    pub(crate) sent: f64,
    /// This stage had it.
    pub(crate) received: f64,
    /// It had all its partners, and the stage took it up.
    pub(crate) begun: f64,
    /// The stage's output was handed over.
    pub(crate) done: f64,
}

impl Passage {
    pub(crate) fn new(order: &[String], traces: &[Trace]) -> Self {
        let place = |name: &str| order.iter().position(|known| known == name).unwrap_or(usize::MAX);
        let mut hops: Vec<Hop> = traces.iter().map(Hop::new).collect();
        hops.sort_by_key(|hop| (place(&hop.stage), hop.epoch));
        let silent =
            order.iter().filter(|name| hops.iter().all(|hop| hop.stage != **name)).cloned().collect();
        Self { seq: traces.first().map_or(0, |trace| trace.seq), hops, silent }
    }

    /// When the last stage was done, milliseconds.
    pub(crate) fn end(&self) -> f64 {
        self.hops.iter().map(|hop| hop.done).fold(0.0, f64::max)
    }

    pub(crate) fn as_json(&self) -> Value {
        let hops: Vec<_> = self
            .hops
            .iter()
            .map(|hop| {
                json!({
                    "stage": hop.stage,
                    "epoch": hop.epoch,
                    "sent_ms": hop.sent,
                    "received_ms": hop.received,
                    "begun_ms": hop.begun,
                    "done_ms": hop.done,
                    "hop_ms": hop.received - hop.sent,
                    "wait_ms": hop.begun - hop.received,
                    "compute_ms": hop.done - hop.begun,
                })
            })
            .collect();
        json!({ "seq": self.seq, "end_ms": self.end(), "hops": hops, "silent": self.silent })
    }

    pub(crate) fn text(&self) -> String {
        let mut text = format!(
            "frame {}: ms after its last byte had come in; - hop, . waiting, # computing\n{:<16} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8} {:>8}\n",
            self.seq, "stage", "sent", "received", "taken up", "done", "hop", "wait", "compute"
        );
        for hop in &self.hops {
            let Hop { sent, received, begun, done, .. } = hop;
            let name =
                if hop.epoch == 0 { hop.stage.clone() } else { format!("{} #{}", hop.stage, hop.epoch) };
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{name:<16} {sent:>9.3} {received:>9.3} {begun:>9.3} {done:>9.3} {:>8.3} {:>8.3} {:>8.3}  |{}|",
                received - sent,
                begun - received,
                done - begun,
                self.bar(hop)
            );
        }
        for stage in &self.silent {
            let _ = writeln!(text, "{stage:<16} did not speak of it");
        }
        text
    }

    /// What a stage did when, over the whole passage.
    fn bar(&self, hop: &Hop) -> String {
        let scale = BAR as f64 / self.end().max(1e-9);
        let sign = |ms: f64| match ms {
            _ if ms < hop.sent || ms > hop.done => ' ',
            _ if ms < hop.received => '-',
            _ if ms < hop.begun => '.',
            _ => '#',
        };
        let mut bar: Vec<char> = (0..BAR).map(|cell| sign((cell as f64 + 0.5) / scale)).collect();
        // However short, it is seen.
        let done = ((hop.done * scale) as usize).min(BAR - 1);
        if bar.iter().all(|cell| *cell == ' ') {
            bar.get_mut(done).into_iter().for_each(|cell| *cell = '#');
        }
        bar.into_iter().collect()
    }
}

impl Hop {
    fn new(trace: &Trace) -> Self {
        let ms = |ns: i64| ns.saturating_sub(trace.arrival_ns) as f64 * 1e-6;
        // Not known any more: what is left of it counts as waiting.
        let received_ns = if trace.received_ns == 0 { trace.sent_ns } else { trace.received_ns };
        Self {
            stage: Health::text_of(&trace.name),
            epoch: trace.epoch,
            sent: ms(trace.sent_ns),
            received: ms(received_ns),
            begun: ms(trace.begun_ns),
            done: ms(trace.done_ns),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(name: &str, times: [i64; 4]) -> Trace {
        let [sent_ns, received_ns, begun_ns, done_ns] = times.map(|ms| 1_000_000_000 + ms * 1_000_000);
        let name = Health::text(name);
        Trace {
            name,
            seq: 7,
            arrival_ns: 1_000_000_000,
            sent_ns,
            received_ns,
            begun_ns,
            done_ns,
            ..Trace::default()
        }
    }

    #[test]
    fn a_passage_is_in_the_pipeline_s_order_and_names_who_was_silent() {
        let order = ["a", "b", "c"].map(str::to_owned);
        let passage = Passage::new(&order, &[trace("b", [4, 5, 6, 8]), trace("a", [0, 1, 2, 4])]);
        let json = passage.as_json();
        assert_eq!((&json["seq"], &json["end_ms"], &json["silent"]), (&json!(7), &json!(8.0), &json!(["c"])));
        assert_eq!(json["hops"][0]["stage"], "a");
        let b = &json["hops"][1];
        assert_eq!([&b["hop_ms"], &b["wait_ms"], &b["compute_ms"]], [&json!(1.0), &json!(1.0), &json!(2.0)]);
        let text = passage.text();
        let bars: Vec<_> = text.lines().filter_map(|line| line.split('|').nth(1)).collect();
        assert_eq!(
            bars,
            [
                "------......############                        ",
                "                        ------......############"
            ]
        );
    }
}
