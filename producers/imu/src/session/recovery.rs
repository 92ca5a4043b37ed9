//! How soon a module streams again: the real session and a simulated module talk over a line of two ends' speeds, in a time that the
//! test counts.

use evac_formats::wt901c::{Parser, baud_code, register};
use evac_simulator::devices::wt901c::{Line, Module};

use super::{Action, BAUDS, FOUND_ANYWHERE_NS, FOUND_NS, Loss, NOTICED_NS, Phase, Session};
use crate::Config;
use crate::driver::REOPEN_NS;

/// The module measures so often, and both ends look at the line.
const STEP_NS: i64 = 5_000_000;
const SECOND: i64 = 1_000_000_000;

struct Talk {
    session: Session,
    parser: Parser,
    module: Module,
    /// Speed of this end.
    baud: u32,
    plugged: bool,
    now: i64,
}

impl Talk {
    fn new(module: Module, config: &Config) -> Self {
        let mut talk = Self {
            session: Session::new(config),
            parser: Parser::default(),
            module,
            baud: 0,
            plugged: true,
            now: SECOND,
        };
        talk.session.opened(talk.now);
        talk
    }

    fn step(&mut self) {
        self.now += STEP_NS;
        let mut bytes = Vec::new();
        self.module.measure(self.now, [0, 0, 2048], [1, 2, 3], &mut bytes);
        self.hear(&bytes);
        self.session.tick(self.now);
        while let Some(action) = self.session.next_action() {
            match action {
                Action::SetBaud(baud) => self.baud = baud,
                Action::Tell(command) => {
                    let mut answer = Vec::new();
                    if self.baud == self.module.baud() {
                        for byte in command.bytes() {
                            self.module.hear(byte, self.now, &mut answer);
                        }
                    }
                    self.hear(&answer);
                }
            }
        }
    }

    /// What the module has sent comes in, as rubbish where the speeds differ.
    fn hear(&mut self, bytes: &[u8]) {
        if !self.plugged || bytes.is_empty() {
            return;
        }
        self.session.heard_bytes(bytes.len());
        for byte in bytes {
            let byte = if self.baud == self.module.baud() { *byte } else { byte.rotate_left(3) | 0x80 };
            if let Some(frame) = self.parser.push(byte) {
                self.session.heard(&frame, self.now);
            }
        }
    }

    /// Lets time pass until `done`; how long that took.
    #[track_caller]
    fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) -> i64 {
        let began = self.now;
        while !done(self) {
            self.step();
            assert!(self.now - began < 60 * SECOND, "never: {what}; {:?}", self.session);
        }
        self.now - began
    }

    fn streams(&self) -> bool {
        self.session.phase() == Phase::Streaming
    }
}

#[test]
fn a_module_at_any_speed_streams_within_the_stated_time() {
    for baud in BAUDS {
        let module = Module::new(Line::Serial).configured(&[(register::BAUD, baud_code(baud).unwrap())], 0.0);
        let mut talk = Talk::new(module, &Config::default());
        let took = talk.until("the stream", Talk::streams);
        assert!(took <= FOUND_ANYWHERE_NS, "{baud}: {took} ns");
        assert_eq!((talk.module.baud(), talk.session.refused().next()), (115_200, None));
    }
}

#[test]
fn a_module_that_is_plugged_in_again_streams_within_the_stated_time_and_sooner_if_it_has_kept_its_settings() {
    for (save, stated_ns) in [(true, FOUND_NS), (false, FOUND_ANYWHERE_NS)] {
        let mut talk = Talk::new(Module::new(Line::Serial), &Config { save, ..Config::default() });
        talk.until("the stream", Talk::streams);
        talk.plugged = false;
        for _ in 0..100 {
            talk.step();
        }
        talk.module.power_cycle();
        talk.plugged = true;
        talk.session.opened(talk.now);
        let took = talk.until("the stream", Talk::streams);
        assert!(took <= stated_ns, "saved {save}: {took} ns");
    }
}

#[test]
fn silence_and_rubbish_are_noticed_within_the_stated_time_and_the_module_is_found_again() {
    // Without saving, a power cycle takes it back to 9600 baud: rubbish. Without a cable there is silence.
    for loss in [Loss::Silence, Loss::Garbage] {
        let mut talk = Talk::new(Module::new(Line::Serial), &Config { save: false, ..Config::default() });
        talk.until("the stream", Talk::streams);
        match loss {
            Loss::Silence => talk.plugged = false,
            Loss::Garbage => talk.module.power_cycle(),
        }
        let noticed = talk.until("the loss", |talk| !talk.streams());
        assert!(noticed <= NOTICED_NS + STEP_NS, "{loss:?}: {noticed} ns");
        assert_eq!(talk.session.loss, Some(loss));
        talk.plugged = true;
        let took = talk.until("the stream", Talk::streams);
        assert!(took <= FOUND_ANYWHERE_NS, "{loss:?}: {took} ns");
    }
}

#[test]
fn the_document_states_the_times_that_are_tested() {
    let document = include_str!("../../../../docs/devices.md");
    let seconds = |time_ns: i64| (time_ns as f64 * 1e-8).ceil() * 0.1;
    let [kept, forgotten, anywhere] =
        [FOUND_NS + REOPEN_NS, FOUND_ANYWHERE_NS + REOPEN_NS, FOUND_ANYWHERE_NS].map(seconds);
    for stated in [
        format!("it streams in {kept:.1} s; in {forgotten:.1} s if it has forgotten"),
        format!("noticed in {} s; it streams in {anywhere:.1} s", NOTICED_NS / SECOND),
    ] {
        assert!(document.contains(&stated), "{stated}");
    }
}
