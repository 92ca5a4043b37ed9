//! The driver: a port, a conversation and a stream.

use std::time::Duration;

use evac_formats::wt901c::{Parser, id};
use evac_frames::{
    DeviceHealth, DeviceKind, FrameHeader, ImuSample, NO_DEVICE_STATE, NO_TEMPERATURE, frame_flags,
};
use evac_stage::{Device, ImuOutput, Reporter, Rig, StageConfig, StageError};
use rustix::time::{ClockId, clock_gettime};

use crate::link::{Heard, Link};
use crate::note::{Facts, Note};
use crate::poll::Poller;
use crate::rest::Rest;
use crate::sampler::Sampler;
use crate::session::{Action, Loss, Phase, Session};
use crate::{Config, Protocol};

/// Between two attempts to open the port, nanoseconds.
pub(crate) const REOPEN_NS: i64 = 200_000_000;
/// Between two notes, nanoseconds.
const NOTE_NS: i64 = 500_000_000;
/// Bytes of one read: more than a stall of 100 ms at 230400 baud gives.
const READ: usize = 4096;

/// A WT901C on a serial port.
#[derive(Debug)]
pub struct Imu {
    config: Config,
    port_name: String,
    link: Option<Link>,
    /// Why the port is not open.
    closed: String,
    next_open_ns: i64,
    parser: Parser,
    session: Session,
    sampler: Sampler,
    /// For a module on RS485.
    poller: Option<Poller>,
    rest: Rest,
    last_phase: Phase,
    last_sample: Option<ImuSample>,
    opened: u64,
    published: u64,
    unplugged: u64,
    losses: u64,
    last_loss: Option<Loss>,
    /// As the module says it, 0.01 degrees Celsius.
    temperature_centi: i32,
    note: Note,
    next_note_ns: i64,
    buffer: Box<[u8; READ]>,
}

impl Device for Imu {
    const NAME: &'static str = "imu";
    type Config = Config;
    type Output = ImuOutput;

    fn new(config: Config, rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        let port_name = config.usb_id.clone().unwrap_or_else(|| config.port.display().to_string());
        Ok(Self {
            port_name,
            link: None,
            closed: String::new(),
            next_open_ns: i64::MIN,
            parser: Parser::default(),
            session: Session::new(&config),
            sampler: Sampler::new(&config),
            poller: (config.protocol == Protocol::Modbus).then(|| Poller::new(&config)),
            rest: Rest::new(&config, rig),
            last_phase: Phase::Searching,
            last_sample: None,
            opened: 0,
            published: 0,
            unplugged: 0,
            losses: 0,
            last_loss: None,
            temperature_centi: NO_TEMPERATURE,
            note: Note::new(),
            next_note_ns: i64::MIN,
            buffer: Box::new([0; READ]),
            config,
        })
    }

    fn serve(
        &mut self,
        output: &mut ImuOutput,
        reporter: &mut Reporter,
        patience: Duration,
    ) -> Result<(), StageError> {
        let now = now_ns();
        self.open_if_due(now);
        let Some(link) = &mut self.link else {
            self.report(reporter, now);
            let left = Duration::from_nanos((self.next_open_ns - now).max(0).unsigned_abs());
            std::thread::sleep(left.min(patience));
            return Ok(());
        };
        let streaming = self.last_phase == Phase::Streaming;
        let poll_ns = self.poller.as_ref().filter(|_| streaming).map_or(i64::MAX, Poller::due_ns);
        let until_ns = self.session.deadline_ns().min(poll_ns);
        let deadline = until_ns.saturating_sub(now).clamp(0, patience.as_nanos() as i64);
        let heard = link.read(self.buffer.as_mut_slice(), Duration::from_nanos(deadline.unsigned_abs()));
        let now = now_ns();
        let result = match heard {
            Heard::Bytes(count) => self.take(count, now, output, reporter),
            Heard::Nothing => Ok(()),
            Heard::Gone => {
                self.close("the port has hung up");
                Ok(())
            }
        };
        self.session.tick(now);
        self.act();
        self.follow(now);
        self.poll(now);
        self.report(reporter, now);
        result
    }

    fn finish(&mut self, output: &mut ImuOutput) -> Result<(), StageError> {
        let last = self.last_sample.unwrap_or_default();
        output.publish(&ImuSample { flags: frame_flags::END_OF_STREAM, ..last }).map(|_| ())
    }
}

impl Imu {
    fn open_if_due(&mut self, now: i64) {
        if self.link.is_some() || now < self.next_open_ns {
            return;
        }
        self.next_open_ns = now + REOPEN_NS;
        match Link::open(&self.config) {
            Ok(link) => {
                tracing::info!(port = self.port_name, "opened");
                self.link = Some(link);
                self.opened += 1;
                self.closed.clear();
                self.session.opened(now);
                self.last_phase = Phase::Searching;
                self.act();
            }
            Err(cause) if cause != self.closed => {
                tracing::warn!("{cause}");
                self.closed = cause;
                self.next_note_ns = now;
            }
            Err(_) => {}
        }
    }

    fn close(&mut self, why: &str) {
        tracing::warn!(port = self.port_name, "{why}");
        self.unplugged += 1;
        self.link = None;
        self.closed.clear();
        self.closed.push_str(why);
        self.next_note_ns = i64::MIN;
    }

    /// Does what the conversation wants.
    fn act(&mut self) {
        while let Some(action) = self.session.next_action() {
            let Some(link) = &mut self.link else { return };
            let done = match action {
                Action::SetBaud(baud) => link.set_baud(baud),
                Action::Tell(command) => match &mut self.poller {
                    Some(poller) => link.write(&poller.request(command)),
                    None => link.write(&command.bytes()),
                },
            };
            if !done {
                self.close("the port cannot be written to");
            }
        }
    }

    /// Asks a module that does not stream for its next sample.
    fn poll(&mut self, now: i64) {
        let byte_ns = self.byte_ns();
        let Some((poller, link)) = self.poller.as_mut().zip(self.link.as_mut()) else { return };
        if self.last_phase != Phase::Streaming {
            return;
        }
        if let Some(question) = poller.ask(now, byte_ns)
            && !link.write(&question)
        {
            self.close("the port cannot be written to");
        }
    }

    /// How long a byte takes on the line, nanoseconds.
    fn byte_ns(&self) -> i64 {
        10_000_000_000 / i64::from(self.session.baud().max(1))
    }

    /// Handles bytes that were read at `now`.
    fn take(
        &mut self,
        count: usize,
        now: i64,
        output: &mut ImuOutput,
        reporter: &mut Reporter,
    ) -> Result<(), StageError> {
        self.session.heard_bytes(count);
        let byte_ns = self.byte_ns();
        for at in 0..count {
            let Some(byte) = self.buffer.get(at).copied() else { continue };
            // So many bytes came after it, each of which took its time.
            let came_ns = now - (count - 1 - at) as i64 * byte_ns;
            if self.poller.is_some() {
                if let Some(sample) = self.hear_answer(byte, now) {
                    self.publish(sample, now, output, reporter)?;
                }
                continue;
            }
            self.hear_frame(byte, came_ns, now, output)?;
            while let Some((sample, attitude)) = self.sampler.pop() {
                self.publish(sample, now, output, reporter)?;
                if let Some(attitude) = attitude {
                    output.publish_attitude(&attitude)?;
                }
            }
        }
        Ok(())
    }

    fn publish(
        &mut self,
        sample: ImuSample,
        now: i64,
        output: &mut ImuOutput,
        reporter: &mut Reporter,
    ) -> Result<(), StageError> {
        reporter.begin();
        let sent = output.publish(&sample)?;
        self.published += 1;
        let header = FrameHeader {
            seq: sent.seq,
            start_ns: sent.stamp_ns,
            end_ns: sent.stamp_ns,
            arrival_ns: now,
            sent_ns: sent.sent_ns,
            ..FrameHeader::default()
        };
        reporter.done(&header, now);
        self.rest.push(sample.stamp_ns, sample.gyro, sample.accel);
        self.last_sample = Some(sent);
        Ok(())
    }

    /// A byte of a module that streams.
    fn hear_frame(
        &mut self,
        byte: u8,
        came_ns: i64,
        now: i64,
        output: &mut ImuOutput,
    ) -> Result<(), StageError> {
        let Some(frame) = self.parser.push(byte) else { return Ok(()) };
        self.session.heard(&frame, now);
        if frame.id == id::ACCEL {
            self.temperature_centi = i32::from(frame.words()[3]);
        }
        if self.session.phase() != Phase::Streaming {
            return Ok(());
        }
        self.follow(now);
        if let Some(attitude) = self.sampler.push_other(&frame) {
            output.publish_attitude(&attitude)?;
        }
        self.sampler.push(&frame, came_ns, now);
        Ok(())
    }

    /// A byte of a module that is asked.
    fn hear_answer(&mut self, byte: u8, now: i64) -> Option<ImuSample> {
        let poller = self.poller.as_mut()?;
        if self.session.phase() == Phase::Streaming {
            let sample = poller.hear_sample(byte, now)?;
            self.session.heard_sample(now);
            return Some(sample);
        }
        let value = poller.hear_answer(byte)?;
        self.session.heard_answer(value, now);
        None
    }

    /// Notices that the conversation has moved on.
    fn follow(&mut self, now: i64) {
        if let Some(loss) = self.session.loss.take() {
            self.losses += 1;
            self.last_loss = Some(loss);
        }
        let phase = self.session.phase();
        if phase == self.last_phase {
            return;
        }
        self.last_phase = phase;
        self.next_note_ns = now;
        if phase == Phase::Streaming {
            tracing::info!(baud = self.session.baud(), "the module streams");
            self.sampler.begin(self.session.baud());
        }
    }

    fn report(&mut self, reporter: &mut Reporter, now: i64) {
        let counts = self.sampler.counts;
        let polled = self.poller.as_ref().map_or((0, 0, 0), |p| (p.lost, p.repeated, p.skipped()));
        reporter.input.imu_lost = counts.lost + polled.0;
        reporter.counters.late = counts.untimed + polled.1;
        reporter.counters.degraded = self.losses + self.unplugged;
        reporter.counters.rejected = self.parser.skipped() + polled.2;
        reporter.device = DeviceHealth {
            used: self.published,
            lost: reporter.input.imu_lost,
            late: polled.1,
            corrupt: reporter.counters.rejected,
            untimed: counts.untimed,
            clock_steps: counts.clock_steps,
            sessions: self.opened,
            kind: DeviceKind::Wt901c as u32,
            state: NO_DEVICE_STATE,
            temperature_centi: self.temperature_centi,
            ..DeviceHealth::default()
        };
        if now < self.next_note_ns {
            return;
        }
        self.next_note_ns = now + NOTE_NS;
        let quality = self.sampler.quality();
        let facts = Facts {
            port: &self.port_name,
            closed: if self.link.is_some() { "" } else { &self.closed },
            phase: Some(self.last_phase),
            baud: self.session.baud(),
            in_vain: self.session.in_vain,
            rubbish: self.session.rubbish,
            refused: self.session.refused().next(),
            asked: self.poller.is_some(),
            wanted_hz: self.config.rate_hz,
            rate_hz: self.sampler.rate_hz(),
            jitter_ms: quality.roughness_ns * 1e-6,
            drift_ppm: quality.drift_ppm,
            finding: self.rest.finding,
            gyro: self.rest.gyro(),
            gyro_range_dps: self.config.gyro_range_dps,
            zeroed: self.rest.zeroed,
            latency_timer_ms: self.link.as_ref().and_then(|link| link.latency_timer_ms),
            unplugged: self.unplugged,
            losses: self.losses,
            last_loss: self.last_loss,
            counts,
        };
        reporter.note(self.note.write(&facts));
    }
}

pub(crate) fn now_ns() -> i64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}
