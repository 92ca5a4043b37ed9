//! Bytes on their way to the disk: a thread of its own writes and syncs them, so that a slow disk holds up nobody.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;

use evac_formats::FormatError;

/// The end of a pipe to the disk that is written to. Nothing is handed over before [`Write::flush`].
#[derive(Debug)]
pub(crate) struct DiskWriter {
    buffer: Vec<u8>,
    position: u64,
    full: SyncSender<Vec<u8>>,
    /// Buffers that were written.
    empty: Receiver<Vec<u8>>,
}

/// The thread behind a [`DiskWriter`].
#[derive(Debug)]
pub(crate) struct Disk {
    path: PathBuf,
    thread: JoinHandle<io::Result<()>>,
}

/// Creates a file that must not exist yet; `queue` buffers may wait for the disk.
pub(crate) fn create(path: &Path, queue: usize) -> Result<(DiskWriter, Disk), FormatError> {
    let failed = |cause| FormatError::writing(path, cause);
    let file = File::create_new(path).map_err(failed)?;
    // The name itself has to survive a power cut too.
    path.parent().map_or(Ok(()), |folder| File::open(folder)?.sync_all()).map_err(failed)?;
    let (full, from_writer) = sync_channel(queue);
    let (to_writer, empty) = sync_channel(queue + 1);
    let thread = std::thread::Builder::new()
        .name("disk".to_owned())
        .spawn(move || write_all(file, &from_writer, &to_writer))
        .map_err(failed)?;
    let writer = DiskWriter { buffer: Vec::new(), position: 0, full, empty };
    Ok((writer, Disk { path: path.to_owned(), thread }))
}

fn write_all(mut file: File, full: &Receiver<Vec<u8>>, empty: &SyncSender<Vec<u8>>) -> io::Result<()> {
    while let Ok(mut buffer) = full.recv() {
        file.write_all(&buffer)?;
        file.sync_data()?;
        buffer.clear();
        // The writer may be gone; then nobody needs the buffer.
        let _ = empty.try_send(buffer);
    }
    file.sync_all()
}

impl Disk {
    /// Whether the thread has ended: by an error, or because its file is whole.
    pub(crate) fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits until everything is on the disk; the [`DiskWriter`] must be gone.
    pub(crate) fn wait(self) -> Result<(), FormatError> {
        let written = self.thread.join().unwrap_or_else(|_| Err(io::Error::other("the writing thread died")));
        written.map_err(|cause| FormatError::writing(&self.path, cause))
    }
}

impl Write for DiskWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.buffer.extend_from_slice(bytes);
        self.position += bytes.len() as u64;
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

/// Only the position is ever asked for: chunks are put together in memory.
impl Seek for DiskWriter {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.position),
            _ => Err(io::Error::from(io::ErrorKind::Unsupported)),
        }
    }
}
