//! Follows a pipeline closely enough to kill one of its processes at a frame: `evac status` takes a second.

use std::collections::BTreeMap;
use std::time::Duration;

use evac_frames::Health;
use evac_ports::services::{HealthStatus, SinkAck};
use evac_ports::{Bus, Domain, RecordSubscriber};

pub(crate) struct Pids {
    health: RecordSubscriber<HealthStatus>,
    acks: RecordSubscriber<SinkAck>,
    newest: BTreeMap<String, Health>,
    acked: u64,
    _bus: Bus,
}

impl Pids {
    /// Listens; the domain must be locked by its launcher.
    pub(crate) fn of(domain: &Domain) -> Self {
        super::common::wait_for("the launcher", || domain.holder());
        let bus = Bus::join(domain, "pids").unwrap();
        let (health, _) = RecordSubscriber::open(&bus).unwrap();
        let (acks, _) = RecordSubscriber::open(&bus).unwrap();
        Self { health, acks, newest: BTreeMap::new(), acked: 0, _bus: bus }
    }

    fn take_in(&mut self) {
        while let Some(health) = self.health.receive().unwrap() {
            let newest = self.newest.entry(Health::text_of(&health.name)).or_insert(health);
            if health.epoch >= newest.epoch {
                *newest = health;
            }
        }
        while let Some(ack) = self.acks.receive().unwrap() {
            self.acked = self.acked.max(ack.seq);
        }
    }

    /// The newest instance of a stage, once some sink has acknowledged frame `seq`.
    pub(crate) fn at(&mut self, stage: &str, seq: u64) -> Health {
        let started = std::time::Instant::now();
        loop {
            self.take_in();
            if self.acked >= seq
                && let Some(health) = self.newest.get(stage)
            {
                return *health;
            }
            assert!(
                started.elapsed() < super::common::WATCHDOG,
                "the watchdog ended the wait for frame {seq}"
            );
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
