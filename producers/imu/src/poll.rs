//! A module on RS485 says nothing by itself: it is asked, over Modbus RTU.

use evac_formats::wt901c::modbus::{REQUEST_BYTES, ReplyParser, Request};
use evac_formats::wt901c::{Command, Scales, register};
use evac_frames::ImuSample;

use crate::Config;
use crate::sampler::scales;

/// Registers of a sample: accelerometer and gyroscope.
const WORDS: usize = 6;
/// An answer that takes longer does not come, nanoseconds.
const ANSWER_NS: i64 = 50_000_000;
/// A module that says the same for longer is not merely asked too often, nanoseconds.
const STALE_NS: i64 = 50_000_000;

/// Asks for samples, and understands answers.
#[derive(Debug)]
pub(crate) struct Poller {
    address: u8,
    period_ns: i64,
    scales: Scales,
    parser: ReplyParser,
    next_ns: i64,
    /// When the module had heard the question that is open.
    asked_ns: Option<i64>,
    last: Option<([i16; WORDS], i64)>,
    skipped: u64,
    /// Questions without an answer.
    pub(crate) lost: u64,
    /// Answers that said what the one before did: asked more often than the module measures.
    pub(crate) repeated: u64,
}

impl Poller {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            address: config.address,
            period_ns: (1e9 / config.rate_hz) as i64,
            scales: scales(config),
            parser: ReplyParser::new(config.address, 1),
            next_ns: i64::MIN,
            asked_ns: None,
            last: None,
            skipped: 0,
            lost: 0,
            repeated: 0,
        }
    }

    /// Bytes that belong to no answer.
    pub(crate) fn skipped(&self) -> u64 {
        self.skipped + self.parser.skipped()
    }

    /// The bytes of a command; its answer is one register.
    pub(crate) fn request(&mut self, command: Command) -> [u8; REQUEST_BYTES] {
        self.expect(1);
        let request = match command.register {
            register::READ => Request::Read { first: command.value as u8, count: 1 },
            register => Request::Write { register, value: command.value },
        };
        request.bytes(self.address)
    }

    /// When to ask for the next sample.
    pub(crate) fn due_ns(&self) -> i64 {
        self.asked_ns.map_or(self.next_ns, |asked_ns| asked_ns + ANSWER_NS)
    }

    /// The question for a sample, where it is due at `now_ns`; a byte takes `byte_ns` on the line.
    pub(crate) fn ask(&mut self, now_ns: i64, byte_ns: i64) -> Option<[u8; REQUEST_BYTES]> {
        if now_ns < self.due_ns() {
            return None;
        }
        self.lost += u64::from(self.asked_ns.is_some());
        self.expect(WORDS);
        let request = Request::Read { first: register::VALUES, count: WORDS as u8 }.bytes(self.address);
        self.asked_ns = Some(now_ns + REQUEST_BYTES as i64 * byte_ns);
        // After a stall from now on, not all at once what was missed.
        self.next_ns =
            if self.next_ns < now_ns - self.period_ns { now_ns } else { self.next_ns } + self.period_ns;
        Some(request)
    }

    /// An answer to [`Self::request`], where this byte completes one.
    pub(crate) fn hear_answer(&mut self, byte: u8) -> Option<u16> {
        self.parser.push(byte).map(|registers| registers[0])
    }

    /// A sample, where this byte completes one. It was measured when the module had heard the question.
    pub(crate) fn hear_sample(&mut self, byte: u8, arrival_ns: i64) -> Option<ImuSample> {
        let registers = self.parser.push(byte)?;
        let stamp_ns = self.asked_ns.take()?;
        let [ax, ay, az, gx, gy, gz, ..] = registers.map(u16::cast_signed);
        let words = [ax, ay, az, gx, gy, gz];
        if self.last.is_some_and(|(last, since_ns)| last == words && stamp_ns - since_ns < STALE_NS) {
            self.repeated += 1;
            return None;
        }
        self.last = Some((words, stamp_ns));
        let (accel, gyro) = (self.scales.accel([ax, ay, az]), self.scales.gyro([gx, gy, gz]));
        Some(ImuSample { stamp_ns, arrival_ns, gyro, accel, ..ImuSample::default() })
    }

    fn expect(&mut self, count: usize) {
        self.parser.restart();
        self.skipped += self.parser.skipped();
        self.parser = ReplyParser::new(self.address, count);
        self.asked_ns = None;
    }
}
