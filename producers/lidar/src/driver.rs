//! The driver: sockets, session and intake put together, and what they say about themselves.

use std::time::Duration;

use evac_frames::{DeviceHealth, DeviceKind};
use evac_stage::{Device, LidarOutput, Reporter, Rig, StageConfig as _, StageError, StageOutput as _};
use rustix::time::ClockId;

use crate::condition::{Condition, Silence};
use crate::intake::{Intake, Outlet};
use crate::receive::{BATCH, nanoseconds};
use crate::session::{Host, Outbox, Phase, SECOND, Session, View};
use crate::sockets::Sockets;
use crate::{Config, PacketCounts, Protocol};

/// No data for so long is worth saying.
const QUIET_NS: i64 = SECOND;

/// A Livox LiDAR; publishes `lidar/scan`, and on request `imu/sample`, on the host's monotonic clock.
#[derive(Debug)]
pub struct Lidar {
    config: Config,
    /// With their conversation, once the interface is there.
    open: Option<(Sockets, Session)>,
    outbox: Outbox,
    intake: Intake,
    condition: Condition,
    described_ns: i64,
    tick_ns: i64,
}

impl Device for Lidar {
    const NAME: &'static str = "lidar";
    type Config = Config;
    type Output = LidarOutput;

    fn services(config: &Config) -> &'static [&'static str] {
        if config.publish_imu { LidarOutput::SERVICES } else { LidarOutput::SCANS_ONLY }
    }

    fn new(config: Config, _rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        Ok(Self {
            open: None,
            outbox: Outbox::default(),
            intake: Intake::new(&config),
            condition: Condition::default(),
            described_ns: 0,
            tick_ns: 0,
            config,
        })
    }

    fn serve(
        &mut self,
        output: &mut LidarOutput,
        reporter: &mut Reporter,
        patience: Duration,
    ) -> Result<(), StageError> {
        let Some((sockets, mut session)) = self.open.take() else {
            self.open(reporter, patience);
            return Ok(());
        };
        let mut outlet = Outlet { output, reporter, result: Ok(()) };
        self.serve_with(&sockets, &mut session, &mut outlet, patience);
        self.open = Some((sockets, session));
        outlet.result
    }

    fn finish(&mut self, output: &mut LidarOutput) -> Result<(), StageError> {
        if let (Some((sockets, session)), true) = (&mut self.open, self.config.stop_at_exit) {
            session.end(&mut self.outbox);
            send(&mut self.outbox, sockets);
        }
        if !self.config.publish_imu {
            return Ok(());
        }
        output.imu.publish(&self.intake.last_sample()).map(|_| ())
    }
}

impl Lidar {
    /// What was done with packets since the start.
    pub fn counts(&self) -> PacketCounts {
        self.intake.counts()
    }

    /// Port of this computer that the device sends data to, once the sockets are open.
    pub fn data_port(&self) -> Option<u16> {
        self.open.as_ref().map(|(sockets, _)| sockets.data_port())
    }

    /// Port of this computer for commands, once the sockets are open.
    pub fn command_port(&self) -> Option<u16> {
        self.open.as_ref().map(|(sockets, _)| sockets.command_port())
    }

    /// Opens the sockets; the network may come up later than this process.
    fn open(&mut self, reporter: &mut Reporter, patience: Duration) {
        match Sockets::open(&self.config) {
            Ok(sockets) => {
                tracing::info!(
                    interface = %self.config.interface,
                    data_port = sockets.data_port(),
                    receive_buffer = sockets.receive_buffer(),
                    "listening"
                );
                let host = Host {
                    address: self.config.interface,
                    command_port: sockets.command_port(),
                    data_port: sockets.data_port(),
                };
                self.open = Some((sockets, Session::new(&self.config, host)));
            }
            Err(error) => {
                let text = error.to_string();
                if reporter.noted().is_empty() || !text.starts_with(&reporter.noted()) {
                    tracing::warn!("{text}");
                    reporter.note(&text);
                }
                std::thread::sleep(patience);
            }
        }
    }

    fn serve_with(
        &mut self,
        sockets: &Sockets,
        session: &mut Session,
        outlet: &mut Outlet<'_>,
        patience: Duration,
    ) {
        let now = nanoseconds(ClockId::Monotonic);
        let until_tick = self.tick_ns.saturating_sub(now).max(0);
        let (pause_ns, with_data) = match self.intake.pile_ns(now) {
            Some(pile_ns) => (pile_ns, false),
            None => (self.intake.until_given_up_ns(now), true),
        };
        let pause = Duration::from_nanos(until_tick.min(pause_ns).unsigned_abs()).min(patience);
        sockets.wait(pause, with_data);
        let now = nanoseconds(ClockId::Monotonic);
        self.control(sockets, session, now);
        self.intake.take_in(&sockets.data, &session.view(), outlet);
        self.intake.give_up(now, outlet);
        if now >= self.tick_ns {
            self.tick_ns = session.tick(now, self.intake.data_ns, &mut self.outbox);
            send(&mut self.outbox, sockets);
        }
        self.report(&session.view(), now, outlet.reporter);
    }

    /// Takes all control datagrams that have come.
    fn control(&mut self, sockets: &Sockets, session: &mut Session, now: i64) {
        let mut buffer = [0; 2048];
        // A flood is no reason to forget the data.
        for _ in 0..BATCH {
            let Some((from, bytes)) = sockets.receive(&mut buffer) else { break };
            let device = session.view().device.or(self.config.device);
            if session.receive(now, from, bytes, &mut self.outbox) {
                // What comes next in the conversation need not wait.
                self.tick_ns = now;
            } else {
                self.intake.refuse(device.is_some_and(|device| device != *from.ip()));
            }
        }
        send(&mut self.outbox, sockets);
    }

    /// Counts and says what there is to say, now and then.
    fn report(&mut self, view: &View, now: i64, reporter: &mut Reporter) {
        if now - self.described_ns < SECOND / 10 {
            return;
        }
        self.described_ns = now;
        let counts = self.counts();
        reporter.counters.late = counts.late;
        reporter.counters.rejected = counts.strangers + counts.damaged;
        reporter.input.imu_lost = counts.imu_lost;
        reporter.device = device_health(self.config.protocol, view, &counts);
        let is_quiet = |newest_ns: i64| view.phase == Phase::Sampling && now - newest_ns > QUIET_NS;
        let silence = if is_quiet(self.intake.data_ns) {
            Silence::Everything
        } else if self.config.publish_imu && is_quiet(self.intake.imu_ns) {
            Silence::Imu
        } else {
            Silence::None
        };
        self.condition.describe(view, &counts, silence);
        reporter.note(&self.condition.text);
    }
}

/// What is known of the device, for health reports.
fn device_health(protocol: Protocol, view: &View, counts: &PacketCounts) -> DeviceHealth {
    let kind = match protocol {
        Protocol::Sdk1 => DeviceKind::LivoxSdk1,
        Protocol::Sdk2 => DeviceKind::LivoxSdk2,
    };
    DeviceHealth {
        used: counts.used,
        lost: counts.lost,
        late: counts.late,
        foreign: counts.strangers,
        corrupt: counts.damaged,
        untimed: counts.unsure,
        imu: counts.imu,
        clock_steps: counts.segments,
        sessions: view.sessions,
        kind: kind as u32,
        state: view.said.state,
        status: view.said.status,
        temperature_centi: view.said.temperature_centi,
        codes: view.said.codes,
    }
}

fn send(outbox: &mut Outbox, sockets: &Sockets) {
    outbox.drain(|channel, to, bytes| {
        // A cable that is not plugged in: the session repeats itself.
        if let Err(cause) = sockets.send(channel, to, bytes) {
            tracing::debug!(%to, %cause, "cannot send");
        }
    });
}
