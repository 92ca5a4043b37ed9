//! The conversation with a module that streams: find its speed, set it, listen. No input or output of its own: bytes and times
//! come in, [`Action`]s go out.

use std::collections::VecDeque;

use evac_formats::wt901c::{Command, FRAME_BYTES, Frame, bandwidth_code, baud_code, id, rate_code, register};

use crate::{Config, Protocol};

#[cfg(test)]
mod recovery;

/// How long to listen at one speed, nanoseconds.
const LISTEN_NS: i64 = 500_000_000;
/// Between two questions that make even a slow module talk, nanoseconds.
const ASK_NS: i64 = 120_000_000;
/// How long an answer may take, nanoseconds.
const ANSWER_NS: i64 = 200_000_000;
/// The vendor's pause after the key, nanoseconds.
const KEY_NS: i64 = 20_000_000;
/// Until a written setting is read back, nanoseconds.
const SETTLE_NS: i64 = 60_000_000;
/// Until an adapter has sent a command, and the line's speed may be changed, nanoseconds.
const SWITCH_NS: i64 = 30_000_000;
/// Until a new speed is tried, nanoseconds.
const BAUD_SETTLE_NS: i64 = 180_000_000;
/// A stream that gives no frame for so long is lost, nanoseconds.
const SILENCE_NS: i64 = 1_000_000_000;
const ATTEMPTS: u32 = 3;

// Stated in docs/devices.md, from the times above.
/// That a stream is lost is known within this time.
#[cfg(test)]
const NOTICED_NS: i64 = SILENCE_NS;
/// A module that talks at the speed at which it was last heard streams within this time: one listening, five questions.
#[cfg(test)]
const FOUND_NS: i64 = LISTEN_NS + 5 * ANSWER_NS;
/// A module at any other speed, with all settings to be written: it is listened for at the last speed, at the wanted one and at
/// all nine; each setting is asked for, written and asked for again, and the line's speed changed.
#[cfg(test)]
const FOUND_ANYWHERE_NS: i64 =
    11 * LISTEN_NS + 5 * (2 * ANSWER_NS + KEY_NS + SETTLE_NS) + SWITCH_NS + BAUD_SETTLE_NS + KEY_NS;
/// Frames that are found in rubbish by no chance.
const CERTAIN_FRAMES: u32 = 4;

/// Speeds by how likely they are.
const BAUDS: [u32; 9] = [9600, 115_200, 230_400, 57_600, 38_400, 19_200, 460_800, 921_600, 4800];

/// What the session wants done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Action {
    /// Set the line's speed and forget what has come in.
    SetBaud(u32),
    Tell(Command),
}

/// Where the conversation is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Listening at one speed after another.
    Searching,
    /// Reading and writing settings.
    Setting,
    /// Samples come.
    Streaming,
}

/// Why a stream was given up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Loss {
    /// Nothing came.
    Silence,
    /// Bytes came, but no frames.
    Garbage,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Listen {
        asked: u32,
        frames: u32,
        since_ns: i64,
    },
    /// Waits for the value of a setting.
    Ask,
    /// The key has been sent.
    Unlocked,
    /// A new speed has been written; an adapter may not have sent it yet.
    Switching,
    /// A setting has been written.
    Written,
    /// The key has been sent, to save.
    Saving,
    Stream,
}

/// One register as it should be.
#[derive(Debug, Clone, Copy)]
struct Setting {
    register: u8,
    value: u16,
    refused: bool,
}

/// See the module.
#[derive(Debug)]
pub(crate) struct Session {
    settings: Vec<Setting>,
    configure: bool,
    save: bool,
    wanted_baud: u32,
    baud: u32,
    /// Which of [`BAUDS`] comes next.
    next_baud: usize,
    step: Step,
    until_ns: i64,
    setting: usize,
    attempts: u32,
    written: bool,
    last_frame_ns: i64,
    bytes_since_frame: u64,
    actions: VecDeque<Action>,
    /// Speeds that were listened at in vain, since the last frame.
    pub(crate) in_vain: u32,
    /// Bytes of rubbish in this search.
    pub(crate) rubbish: u64,
    /// Why the last stream ended; taken by whoever reports it.
    pub(crate) loss: Option<Loss>,
}

impl Session {
    pub(crate) fn new(config: &Config) -> Self {
        let wanted = [
            (register::BAUD, baud_code(config.baud).unwrap_or(6)),
            (register::CONTENT, config.content()),
            (register::RATE, rate_code(config.rate_hz).unwrap_or(11)),
            (register::BANDWIDTH, bandwidth_code(config.bandwidth_hz).unwrap_or(1)),
            (register::ALGORITHM, u16::from(config.six_axes)),
        ];
        // A module that is asked for registers has no frames.
        let has = |register| config.protocol == Protocol::Serial || register != register::CONTENT;
        let settings = wanted.iter().filter(|(register, _)| has(*register));
        Self {
            settings: settings
                .map(|(register, value)| Setting { register: *register, value: *value, refused: false })
                .collect(),
            configure: config.configure,
            save: config.save,
            wanted_baud: config.baud,
            baud: config.baud,
            next_baud: BAUDS.len() - 1,
            step: Step::Stream,
            until_ns: 0,
            setting: 0,
            attempts: 0,
            written: false,
            last_frame_ns: 0,
            bytes_since_frame: 0,
            actions: VecDeque::with_capacity(8),
            in_vain: 0,
            rubbish: 0,
            loss: None,
        }
    }

    /// The port has been opened: a search begins, at the speed that was right last.
    pub(crate) fn opened(&mut self, now_ns: i64) {
        for setting in &mut self.settings {
            setting.refused = false;
        }
        self.actions.clear();
        (self.in_vain, self.rubbish, self.loss) = (0, 0, None);
        self.listen(self.baud, now_ns);
    }

    pub(crate) fn phase(&self) -> Phase {
        match self.step {
            Step::Listen { .. } => Phase::Searching,
            Step::Stream => Phase::Streaming,
            _ => Phase::Setting,
        }
    }

    /// Speed of the line now.
    pub(crate) fn baud(&self) -> u32 {
        self.baud
    }

    /// Registers that the module did not take.
    pub(crate) fn refused(&self) -> impl Iterator<Item = u8> {
        self.settings.iter().filter(|setting| setting.refused).map(|setting| setting.register)
    }

    pub(crate) fn next_action(&mut self) -> Option<Action> {
        self.actions.pop_front()
    }

    /// When [`Self::tick`] has something to do.
    pub(crate) fn deadline_ns(&self) -> i64 {
        if self.step == Step::Stream { self.last_frame_ns + SILENCE_NS } else { self.until_ns }
    }

    /// Bytes have come; before the frames in them.
    pub(crate) fn heard_bytes(&mut self, bytes: usize) {
        self.bytes_since_frame += bytes as u64;
    }

    /// A frame has come.
    pub(crate) fn heard(&mut self, frame: &Frame, now_ns: i64) {
        self.last_frame_ns = now_ns;
        match &mut self.step {
            Step::Listen { frames, .. } => {
                *frames += 1;
                // As many bytes in frames as outside of them, or so many frames that they are no chance: of rubbish one
                // byte in a million begins what looks like a frame.
                let inside = u64::from(*frames) * FRAME_BYTES as u64;
                let rubbish = self.bytes_since_frame.saturating_sub(inside);
                if *frames >= CERTAIN_FRAMES || (*frames >= 2 && inside > rubbish) {
                    self.found(now_ns);
                }
            }
            Step::Ask if frame.id == id::REGISTERS => {
                self.answered(frame.words()[0].cast_unsigned(), now_ns);
            }
            Step::Stream => self.bytes_since_frame = 0,
            _ => {}
        }
    }

    /// A module that does not stream has answered a question.
    pub(crate) fn heard_answer(&mut self, value: u16, now_ns: i64) {
        self.last_frame_ns = now_ns;
        match self.step {
            // Its sum has 16 bits: no rubbish passes.
            Step::Listen { .. } => self.found(now_ns),
            Step::Ask => self.answered(value, now_ns),
            _ => {}
        }
    }

    /// A module that does not stream has given a sample.
    pub(crate) fn heard_sample(&mut self, now_ns: i64) {
        (self.last_frame_ns, self.bytes_since_frame) = (now_ns, 0);
    }

    /// Time has passed.
    pub(crate) fn tick(&mut self, now_ns: i64) {
        if now_ns < self.deadline_ns() {
            return;
        }
        match self.step {
            Step::Listen { since_ns, .. } if now_ns >= since_ns + LISTEN_NS => self.listen_elsewhere(now_ns),
            Step::Listen { asked, frames, since_ns } => {
                self.step = Step::Listen { asked: asked + 1, frames, since_ns };
                self.write(Command::read(register::VALUES), now_ns + ASK_NS);
            }
            Step::Ask => self.unanswered(now_ns),
            Step::Unlocked => self.write_setting(now_ns),
            Step::Switching => {
                self.baud = self.wanted_baud;
                self.actions.push_back(Action::SetBaud(self.baud));
                (self.step, self.until_ns) = (Step::Written, now_ns + BAUD_SETTLE_NS);
            }
            Step::Written => self.ask(now_ns),
            Step::Saving => {
                self.write(Command::SAVE, now_ns);
                self.stream(now_ns);
            }
            Step::Stream => {
                self.loss = Some(if self.bytes_since_frame > 0 { Loss::Garbage } else { Loss::Silence });
                self.listen(self.baud, now_ns);
            }
        }
    }

    fn listen(&mut self, baud: u32, now_ns: i64) {
        self.baud = baud;
        self.bytes_since_frame = 0;
        self.actions.push_back(Action::SetBaud(baud));
        self.step = Step::Listen { asked: 0, frames: 0, since_ns: now_ns };
        self.until_ns = now_ns;
    }

    fn listen_elsewhere(&mut self, now_ns: i64) {
        self.in_vain += 1;
        self.rubbish += self.bytes_since_frame;
        let baud = if self.in_vain == 1 && self.baud != self.wanted_baud {
            self.wanted_baud
        } else {
            self.next_baud = (self.next_baud + 1) % BAUDS.len();
            BAUDS.get(self.next_baud).copied().unwrap_or(self.wanted_baud)
        };
        self.listen(baud, now_ns);
    }

    fn found(&mut self, now_ns: i64) {
        (self.in_vain, self.rubbish, self.next_baud) = (0, 0, BAUDS.len() - 1);
        if !self.configure {
            return self.stream(now_ns);
        }
        (self.setting, self.attempts, self.written) = (0, 0, false);
        self.ask(now_ns);
    }

    fn current(&self) -> Option<Setting> {
        self.settings.get(self.setting).copied()
    }

    /// Asks for the current setting's register; where all are done it saves them.
    fn ask(&mut self, now_ns: i64) {
        while self.current().is_some_and(|setting| setting.refused) {
            self.setting += 1;
        }
        match self.current() {
            Some(setting) => {
                self.step = Step::Ask;
                self.write(Command::read(setting.register), now_ns + ANSWER_NS);
            }
            None if self.written && self.save => {
                self.step = Step::Saving;
                self.write(Command::UNLOCK, now_ns + KEY_NS);
            }
            None => self.stream(now_ns),
        }
    }

    fn answered(&mut self, value: u16, now_ns: i64) {
        let Some(setting) = self.settings.get_mut(self.setting) else { return };
        if value == setting.value {
            (self.setting, self.attempts) = (self.setting + 1, 0);
            return self.ask(now_ns);
        }
        self.attempts += 1;
        if self.attempts > ATTEMPTS {
            setting.refused = true;
            self.attempts = 0;
            return self.ask(now_ns);
        }
        self.step = Step::Unlocked;
        self.write(Command::UNLOCK, now_ns + KEY_NS);
    }

    fn unanswered(&mut self, now_ns: i64) {
        self.attempts += 1;
        if self.attempts <= ATTEMPTS {
            return self.ask(now_ns);
        }
        // At a speed that the module has just been told to use: it does not know that speed.
        if let Some(setting) = self.settings.get_mut(self.setting).filter(|s| s.register == register::BAUD)
            && self.written
        {
            setting.refused = true;
        }
        self.listen(self.baud, now_ns);
    }

    fn write_setting(&mut self, now_ns: i64) {
        let Some(setting) = self.current() else { return self.ask(now_ns) };
        self.written = true;
        let switches = setting.register == register::BAUD;
        let (step, pause_ns) =
            if switches { (Step::Switching, SWITCH_NS) } else { (Step::Written, SETTLE_NS) };
        self.step = step;
        self.write(Command::write(setting.register, setting.value), now_ns + pause_ns);
    }

    fn stream(&mut self, now_ns: i64) {
        self.step = Step::Stream;
        (self.last_frame_ns, self.bytes_since_frame) = (now_ns, 0);
    }

    fn write(&mut self, command: Command, until_ns: i64) {
        self.actions.push_back(Action::Tell(command));
        self.until_ns = until_ns;
    }
}
