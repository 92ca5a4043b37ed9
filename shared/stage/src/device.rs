//! The contract of a producer that is a driver: its data comes when it comes, and never ends by itself.

use std::time::Duration;

use crate::{Reporter, Rig, StageConfig, StageError, StageOutput};

/// A driver of a device that may be absent, appear, go away and come back.
pub trait Device: Sized {
    /// Name of the kind, for example `imu`.
    const NAME: &'static str;
    /// Typed configuration.
    type Config: StageConfig;
    /// Where its data goes.
    type Output: StageOutput;

    /// Services that it writes as it is configured: all of its output's, unless it says otherwise.
    fn services(_config: &Self::Config) -> &'static [&'static str] {
        Self::Output::SERVICES
    }

    /// Builds the driver. An absent device is no error: it is looked for until it is there.
    ///
    /// # Errors
    /// [`StageError::Config`].
    fn new(config: Self::Config, rig: &Rig) -> Result<Self, StageError>;

    /// Waits up to `patience` for the device, handles what has come and publishes it. Counts and notes go to `reporter`:
    /// [`Reporter::begin`] and [`Reporter::done`] for each frame, [`Reporter::note`] when what an operator should know
    /// changes. While the device sends, it neither allocates nor locks.
    ///
    /// # Errors
    /// Only what makes going on pointless. A device that is gone, silent or talks nonsense is none: it is noted, and looked for.
    fn serve(
        &mut self,
        output: &mut Self::Output,
        reporter: &mut Reporter,
        patience: Duration,
    ) -> Result<(), StageError>;

    /// Called once on SIGTERM: says that no more will come.
    ///
    /// # Errors
    /// As `serve`.
    fn finish(&mut self, _output: &mut Self::Output) -> Result<(), StageError> {
        Ok(())
    }
}
