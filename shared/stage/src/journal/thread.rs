//! The thread that writes.

use std::io;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};

use super::file::Log;
use super::{Entry, Place, Slip, merge};

/// Time between two visits to the disk.
const SYNC: Duration = Duration::from_secs(1);
/// A log of this size becomes a base, or, while the base is larger, one of the base's size up to the second number.
const LOG_BYTES: [u64; 2] = [16 << 20, 64 << 20];

pub(super) struct Writer {
    log: Log,
    base_bytes: u64,
    max_bytes: u64,
    folder: PathBuf,
}

impl Writer {
    pub(super) fn new(log: Log, place: &Place) -> Self {
        let base_bytes = std::fs::metadata(log.base()).map_or(0, |file| file.len());
        Self { log, base_bytes, max_bytes: place.max_bytes, folder: place.folder.clone() }
    }

    /// Writes until nobody says anything any more.
    pub(super) fn run(mut self, filled: &Receiver<Slip>, empty: &SyncSender<Slip>) {
        crate::scheduling::leave_real_time();
        if let Err(cause) = self.write_all(filled, empty) {
            tracing::error!(
                folder = %self.folder.display(), %cause,
                "the journal ends here: a stage that is killed from now on goes on without it"
            );
            // An old one would be taken for the truth.
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }

    fn write_all(&mut self, filled: &Receiver<Slip>, empty: &SyncSender<Slip>) -> io::Result<()> {
        let mut synced = Instant::now();
        loop {
            match filled.recv_timeout(SYNC) {
                Ok(mut slip) => {
                    self.write(&mut slip)?;
                    // Nobody takes it back where the stage is on its way out.
                    let _ = empty.try_send(slip);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.log.sync(),
            }
            if synced.elapsed() >= SYNC {
                self.log.sync()?;
                synced = Instant::now();
            }
        }
    }

    fn write(&mut self, slip: &mut Slip) -> io::Result<()> {
        if slip.whole {
            let (head, entry) = (slip.head, &mut slip.entry);
            self.log.rotate(|writer| merge::write_whole(head, entry, writer))?;
            // Everything is far more than what the next frames change, and this slip would keep its size.
            *entry = Entry::default();
            return self.measure();
        }
        self.log.write(slip.head, &slip.entry)?;
        let [least, most] = LOG_BYTES;
        if self.log.generation.log_bytes >= self.base_bytes.clamp(least, most) {
            let (base, log) = (self.log.base(), self.log.log());
            self.log.rotate(|writer| merge::merge(&base, &log, writer))?;
            self.measure()?;
        }
        Ok(())
    }

    fn measure(&mut self) -> io::Result<()> {
        self.base_bytes = std::fs::metadata(self.log.base())?.len();
        // The next base is written beside this one and its log.
        let most = 2 * self.base_bytes + LOG_BYTES[1];
        if most > self.max_bytes.max(LOG_BYTES[1]) {
            return Err(io::Error::other(format!(
                "it would take up to {} MiB, more than supervision.journal_max_mib = {}",
                most >> 20,
                self.max_bytes >> 20
            )));
        }
        Ok(())
    }
}
