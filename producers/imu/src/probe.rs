//! Whether a module answers, for `evac doctor`.

use std::time::{Duration, Instant};

use evac_stage::StageError;

use crate::link::{Heard, Link};
use crate::poll::Poller;
use crate::session::{Action, Phase, Session};
use crate::{Config, Protocol};

/// All speeds once, and a little more.
const PATIENCE: Duration = Duration::from_secs(6);

/// A module that answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    /// Speed of its line now.
    pub baud: u32,
}

/// Listens at all speeds, and asks; nothing is set.
///
/// # Errors
/// [`StageError::File`] where the port cannot be opened or nothing that makes sense comes.
pub fn probe(config: Config) -> Result<Found, StageError> {
    let file = StageError::File;
    let mut link = Link::open(&config).map_err(file)?;
    let modbus = config.protocol == Protocol::Modbus;
    let mut poller = Poller::new(&config);
    let until = Instant::now() + PATIENCE;
    let mut session = Session::new(&Config { configure: false, ..config });
    let mut parser = evac_formats::wt901c::Parser::default();
    let mut buffer = [0; 512];
    session.opened(crate::driver::now_ns());
    while Instant::now() < until {
        while let Some(action) = session.next_action() {
            let done = match action {
                Action::SetBaud(baud) => link.set_baud(baud),
                Action::Tell(command) if modbus => link.write(&poller.request(command)),
                Action::Tell(command) => link.write(&command.bytes()),
            };
            if !done {
                return Err(file("the port cannot be written to".to_owned()));
            }
        }
        match link.read(&mut buffer, Duration::from_millis(20)) {
            Heard::Bytes(count) => {
                session.heard_bytes(count);
                for byte in buffer.iter().take(count) {
                    if modbus {
                        if let Some(value) = poller.hear_answer(*byte) {
                            session.heard_answer(value, crate::driver::now_ns());
                        }
                    } else if let Some(frame) = parser.push(*byte) {
                        session.heard(&frame, crate::driver::now_ns());
                    }
                }
            }
            Heard::Nothing => {}
            Heard::Gone => return Err(file("the port has hung up".to_owned())),
        }
        if session.phase() == Phase::Streaming {
            return Ok(Found { baud: session.baud() });
        }
        session.tick(crate::driver::now_ns());
    }
    Err(file(format!("no WT901C at any speed, {} bytes of rubbish", session.rubbish)))
}
