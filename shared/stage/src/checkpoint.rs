//! What a sink has gathered and its inputs no longer show, handed to a standby by way of a file in the domain's folder.

use std::fs;
use std::io;
use std::path::PathBuf;

use evac_ports::{Bus, Domain, PortError, RequestReceiver, RequestSender, now_ns};

use crate::StageError;

/// Event by which a standby asks the sink that leads for its state.
const STATE_REQUEST: &str = "state/request";
/// Time between two requests.
const ASK_AGAIN_NS: i64 = 200_000_000;

/// A sink's side of it, whether it asks or is asked.
#[derive(Debug)]
pub(crate) struct Checkpoints {
    state: PathBuf,
    /// Lies there while the stage of this name is asked: the event is shared by all.
    wanted: PathBuf,
    sender: RequestSender,
    receiver: RequestReceiver,
    asked_ns: i64,
}

impl Checkpoints {
    pub(crate) fn open(bus: &Bus, domain: &Domain, name: &str) -> Result<Self, PortError> {
        Ok(Self {
            state: domain.folder().join(format!("{name}.state")),
            wanted: domain.folder().join(format!("{name}.wanted")),
            sender: RequestSender::open(bus, STATE_REQUEST)?,
            receiver: RequestReceiver::open(bus, STATE_REQUEST)?,
            asked_ns: i64::MIN,
        })
    }

    /// Whether a standby of this stage has asked since the last call.
    pub(crate) fn is_wanted(&self) -> bool {
        self.receiver.take() && self.wanted.exists()
    }

    /// Answers with the state after frame `seq`.
    pub(crate) fn answer(&self, seq: u64, state: &State) -> io::Result<()> {
        let unfinished = self.state.with_extension("state.new");
        let mut bytes = seq.to_le_bytes().to_vec();
        bytes.extend(&state.bytes);
        fs::write(&unfinished, bytes)?;
        fs::rename(&unfinished, &self.state)?;
        fs::remove_file(&self.wanted)
    }

    /// Asks, at first and then now and again.
    pub(crate) fn ask(&mut self) -> Result<(), StageError> {
        let now = now_ns();
        if now < self.asked_ns.saturating_add(ASK_AGAIN_NS) {
            return Ok(());
        }
        self.asked_ns = now;
        fs::write(&self.wanted, []).map_err(|cause| {
            StageError::File(format!("{}: {cause}; is the disk full?", self.wanted.display()))
        })?;
        self.sender.send().map_err(|cause| StageError::Output(cause.to_string()))
    }

    /// The answer, if one has come, with the frame that it holds after.
    pub(crate) fn take(&self) -> Option<(u64, State)> {
        let bytes = fs::read(&self.state).ok()?;
        // One that stays is an answer to nobody.
        let _ = fs::remove_file(&self.state);
        let (seq, rest) = bytes.split_first_chunk()?;
        Some((u64::from_le_bytes(*seq), State { bytes: rest.to_vec(), read: 0 }))
    }
}

/// A stage's state in numbers, read in the order in which they were written.
#[derive(Debug, Default)]
pub struct State {
    bytes: Vec<u8>,
    read: usize,
}

impl State {
    /// Empties it; its memory stays.
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        self.read = 0;
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    pub(crate) fn set_bytes(&mut self, bytes: &[u8]) {
        self.clear();
        self.bytes.extend_from_slice(bytes);
    }

    /// Whether all was read that was written.
    pub fn is_at_end(&self) -> bool {
        self.read >= self.bytes.len()
    }

    /// Adds a whole number.
    pub fn put(&mut self, number: u64) {
        self.bytes.extend(number.to_le_bytes());
    }

    /// Adds real numbers.
    pub fn put_reals(&mut self, numbers: &[f64]) {
        numbers.iter().for_each(|number| self.put(number.to_bits()));
    }

    /// The next whole number.
    ///
    /// # Errors
    /// [`StageError::File`] where there is none: another build has written it.
    pub fn number(&mut self) -> Result<u64, StageError> {
        let next = self.bytes.get(self.read..).and_then(|rest| rest.first_chunk());
        let bytes = next.ok_or_else(|| {
            StageError::File(
                "the state of the instance that leads ends too soon; swap between builds of one version"
                    .to_owned(),
            )
        })?;
        self.read += size_of::<u64>();
        Ok(u64::from_le_bytes(*bytes))
    }

    /// The next real numbers.
    ///
    /// # Errors
    /// As [`Self::number`].
    pub fn reals<const N: usize>(&mut self) -> Result<[f64; N], StageError> {
        let mut reals = [0.0; N];
        for real in &mut reals {
            *real = f64::from_bits(self.number()?);
        }
        Ok(reals)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_is_read_as_it_was_written_and_one_that_is_cut_is_an_error() {
        let mut state = State::default();
        state.put(7);
        state.put_reals(&[0.1, f64::NAN, -0.0]);
        assert_eq!(state.number().unwrap(), 7);
        let [a, b, c] = state.reals().unwrap();
        assert!(a == 0.1 && b.is_nan() && c.to_bits() == (-0.0_f64).to_bits());
        assert!(state.number().is_err());
    }
}
