//! The contract of a processor or consumer.

use serde::{Serialize, de::DeserializeOwned};

use crate::follow::{Followed, Readiness, Routed};
use crate::{Entry, Rig, State};

/// A stage: a pure function of its inputs and its own state. It sees plain slices, never shared memory, clocks or files
/// (sinks excepted, whose work is files).
pub trait Stage: Sized {
    /// Name of the kind, for example `deskewer`.
    const NAME: &'static str;
    /// Typed configuration with every default in sight.
    type Config: StageConfig;
    /// What `process` is called with; see the types in [`crate::input`](crate).
    type Input<'a>;
    /// What `process` writes to.
    type Output: Followed;

    /// Builds the stage; allocates everything it will need.
    ///
    /// # Errors
    /// [`StageError::Config`] for values that do not fit together or with the rig.
    fn new(config: Self::Config, rig: &Rig) -> Result<Self, StageError>;

    /// Called once before the first frame with the whole pipeline as TOML, empty for a stage that runs without one. For stages
    /// that describe what they write.
    ///
    /// # Errors
    /// As `new`.
    fn begin(&mut self, _pipeline: &str) -> Result<(), StageError> {
        Ok(())
    }

    /// Handles one frame. After warm-up it neither allocates nor locks.
    ///
    /// # Errors
    /// Only what makes going on pointless; bad data is dropped, counted and not an error.
    fn process(
        &mut self,
        input: Self::Input<'_>,
        output: &mut Self::Output,
        counters: &mut Counters,
    ) -> Result<(), StageError>;

    /// A standby's frame: what `process` would be called with and, where it came, what the routed instance put out for it. Comes
    /// to the same state as if it had put that out itself, and says whether it could take over with the next frame.
    ///
    /// The default is that of a stage without memory; sinks must write no file here.
    ///
    /// # Errors
    /// As `process`.
    fn follow(
        &mut self,
        _input: Self::Input<'_>,
        _routed: Option<Routed<'_, Self::Output>>,
    ) -> Result<Readiness, StageError> {
        Ok(Readiness::Ready)
    }

    /// What the routed instance put out that no input of this standby belongs to, such as the map's snapshot.
    ///
    /// # Errors
    /// As `process`.
    fn adopt(&mut self, _routed: Routed<'_, Self::Output>) -> Result<(), StageError> {
        Ok(())
    }

    /// A sink's state so far that a standby cannot have from its inputs: the way before it came, for example.
    fn save_state(&self, _state: &mut State) {}

    /// Takes over what the sink that leads had gathered after frame `seq`, in the place of what this one has seen itself. The next
    /// frames may still be older: of these only the map is news.
    ///
    /// # Errors
    /// [`StageError::File`] where it cannot be read.
    fn load_state(&mut self, _state: &mut State, _seq: u64) -> Result<(), StageError> {
        Ok(())
    }

    /// Whether it keeps a journal, from which an instance goes on that is started in the place of one that was killed.
    const JOURNALED: bool = false;

    /// Says what the newest frame has changed of what a crash must not lose, or everything (`whole`). Called after every frame.
    fn write_down(&mut self, _entry: &mut Entry, _whole: bool) {}

    /// Takes back what was written down, in order: in one entry what several have changed, and `Entry::now` only in the last of them.
    ///
    /// # Errors
    /// [`StageError`] where it cannot be read: another build or configuration has written it.
    fn read_back(&mut self, _entry: &mut Entry) -> Result<(), StageError> {
        Ok(())
    }

    /// Answers requests of other stages. Called after every frame and, while none comes, at each request and at least once a second, also
    /// after the last one. Where nothing is asked for it neither allocates nor locks.
    ///
    /// # Errors
    /// As `process`.
    fn serve(&mut self, _output: &mut Self::Output) -> Result<(), StageError> {
        Ok(())
    }

    /// What goes on, in words for an operator, in every health report; empty: nothing to say.
    fn note(&self) -> &str {
        ""
    }

    /// Called once after the last frame or on SIGTERM; sinks finish their files here.
    ///
    /// # Errors
    /// As `process`.
    fn finish(&mut self) -> Result<(), StageError> {
        Ok(())
    }
}

/// Configuration of a stage: what `[[stage]]` tables of a pipeline file are parsed into.
pub trait StageConfig: Default + Serialize + DeserializeOwned {
    /// Checks ranges that types cannot express.
    ///
    /// # Errors
    /// One sentence naming the key, its value, the allowed range and what to try.
    fn check(&self) -> Result<(), String>;
}

/// What a stage counts while it works; published in its health report.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Counters {
    /// Frames that came too late to be used.
    pub late: u64,
    /// Frames dropped or passed on unprocessed by decision of the stage.
    pub degraded: u64,
    /// Points dropped inside frames: not finite or out of range.
    pub rejected: u64,
}

/// Why a stage cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// Values that do not fit together.
    #[error("configuration: {0}")]
    Config(String),
    /// A file could not be read or written; the text names file, cause and remedy.
    #[error("{0}")]
    File(String),
    /// An output could not be published.
    #[error("publishing: {0}")]
    Output(String),
}
