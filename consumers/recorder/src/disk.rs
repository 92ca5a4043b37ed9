//! Bytes on their way to the disk: a thread of its own writes and syncs them, so that a slow disk holds up nobody.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;

use evac_formats::FormatError;
use evac_formats::mcap::BARE_END;

/// The end of a pipe to the disk that is written to. Nothing is handed over before [`Write::flush`].
#[derive(Debug)]
pub(crate) struct DiskWriter {
    buffer: Vec<u8>,
    full: SyncSender<Vec<u8>>,
    /// Buffers that were written.
    empty: Receiver<Vec<u8>>,
}

/// The thread behind a [`DiskWriter`].
#[derive(Debug)]
pub(crate) struct Disk(JoinHandle<Result<(), Refused>>);

/// Why a file goes no further.
#[derive(Debug)]
pub(crate) struct Refused {
    path: PathBuf,
    pub(crate) cause: io::Error,
    /// What was handed over whole and is in it, bytes.
    whole: u64,
    /// It was closed behind that, and is a whole file.
    closed: bool,
}

impl Refused {
    /// For an operator: the cause, what to do, and what is left.
    pub(crate) fn explain(self) -> String {
        let kept = format!("the first {:.1} MB are kept", self.whole as f64 * 1e-6);
        let read = if self.closed { "" } else { ", to be read with --allow-truncated" };
        format!("{}; {kept}{read}", FormatError::writing(&self.path, self.cause))
    }
}

/// Creates a file that must not exist yet; `queue` buffers may wait for the disk.
pub(crate) fn create(path: &Path, queue: usize) -> Result<(DiskWriter, Disk), FormatError> {
    let failed = |cause| FormatError::writing(path, cause);
    let file = File::create_new(path).map_err(failed)?;
    // The name itself has to survive a power cut too.
    path.parent().map_or(Ok(()), |folder| File::open(folder)?.sync_all()).map_err(failed)?;
    let (full, from_writer) = sync_channel(queue);
    let (to_writer, empty) = sync_channel(queue + 1);
    let own_path = path.to_owned();
    let thread = std::thread::Builder::new()
        .name("disk".to_owned())
        .spawn(move || write_all(file, own_path, &from_writer, &to_writer))
        .map_err(failed)?;
    Ok((DiskWriter { buffer: Vec::new(), full, empty }, Disk(thread)))
}

/// Writes what is handed over, each buffer whole or not at all.
fn write_all(
    mut file: File,
    path: PathBuf,
    full: &Receiver<Vec<u8>>,
    empty: &SyncSender<Vec<u8>>,
) -> Result<(), Refused> {
    let mut whole = 0;
    while let Ok(mut buffer) = full.recv() {
        if let Err(cause) = file.write_all(&buffer).and_then(|()| file.sync_data()) {
            let closed = close_behind(&mut file, whole).is_ok();
            return Err(Refused { path, cause, whole, closed });
        }
        whole += buffer.len() as u64;
        buffer.clear();
        // The writer may be gone; then nobody needs the buffer.
        let _ = empty.try_send(buffer);
    }
    file.sync_all().map_err(|cause| Refused { path, cause, whole, closed: false })
}

/// Takes back what a full disk took only in part, which makes the room to close the file.
fn close_behind(file: &mut File, whole: u64) -> io::Result<()> {
    file.set_len(whole)?;
    file.seek(SeekFrom::Start(whole))?;
    file.write_all(&BARE_END)?;
    file.sync_all()
}

impl Disk {
    /// Whether the thread has ended: by an error, or because its file is whole.
    pub(crate) fn has_ended(&self) -> bool {
        self.0.is_finished()
    }

    /// Waits until everything is on the disk; the [`DiskWriter`] must be gone.
    ///
    /// # Errors
    /// What the disk refused.
    pub(crate) fn wait(self) -> Result<(), Refused> {
        let died = |_| {
            let cause = io::Error::other("the writing thread died");
            Err(Refused { path: PathBuf::new(), cause, whole: 0, closed: false })
        };
        self.0.join().unwrap_or_else(died)
    }
}

impl Write for DiskWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.buffer.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    /// Hands over what was written; waits where the queue is full.
    fn flush(&mut self) -> io::Result<()> {
        if self.buffer.is_empty() {
            return Ok(());
        }
        let next = match self.empty.try_recv() {
            Ok(buffer) => buffer,
            Err(TryRecvError::Empty | TryRecvError::Disconnected) => {
                Vec::with_capacity(self.buffer.capacity())
            }
        };
        let gone = |_| io::Error::other("the disk refused what came before");
        self.full.send(std::mem::replace(&mut self.buffer, next)).map_err(gone)
    }
}
