//! What the stages of a running pipeline say about each frame.

use std::time::{Duration, Instant};

use evac_frames::Trace;
use evac_ports::services::FrameTrace;
use evac_ports::{Bus, Domain, RecordSubscriber};

/// Between two looks: the service keeps 256 traces, and five stages write 50 a second.
const LOOK: Duration = Duration::from_millis(200);

/// Reads traces.
pub(crate) struct Traces {
    port: RecordSubscriber<FrameTrace>,
    bus: Bus,
}

impl Traces {
    /// Opens the service. Nothing wakes this process: that would take a core from the stages whose times are measured.
    pub(crate) fn open(domain: &Domain) -> anyhow::Result<Self> {
        let bus = Bus::join(domain, "bench")?;
        let (port, _) = RecordSubscriber::open(&bus)?;
        Ok(Self { port, bus })
    }

    /// Gives each trace to `take` until that has enough.
    ///
    /// # Errors
    /// It has not enough after `patience`, or SIGINT or SIGTERM has come.
    pub(crate) fn follow(
        &self,
        patience: Duration,
        mut take: impl FnMut(&Trace) -> anyhow::Result<bool>,
    ) -> anyhow::Result<()> {
        let started = Instant::now();
        loop {
            while let Some(trace) = self.port.receive()? {
                if take(&trace)? {
                    return Ok(());
                }
            }
            anyhow::ensure!(started.elapsed() < patience, "frames do not come");
            anyhow::ensure!(!self.bus.stop_requested(), "interrupted");
            std::thread::sleep(LOOK);
        }
    }
}
