//! What a stage must not lose with its process, written down frame by frame: an instance that is started in the place of one that
//! was killed reads it and goes on.
//!
//! The stage says after each frame what the frame has changed (an [`Entry`]); a thread of its own writes it to the page cache at once,
//! so that it outlives the process, and to the disk each second. Between the two goes a fixed number of slips that are used again and
//! again. A live stage whose thread does not keep up drops entries, which are counted, and writes down everything once there
//! is room; a lossless one waits. What was under way when the process died is computed again: its inputs are in their writers' history.

mod file;
mod merge;
mod thread;

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

use evac_frames::Voxel;

use crate::{StageError, State};
pub(crate) use file::Head;
use file::{Generation, Log};
use thread::Writer;

/// Entries under way: in lossless mode fewer than frames are in the history of the inputs, so that nothing can be missing between
/// the journal's end and theirs; live, three seconds of a slow disk.
const LOSSLESS_SLIPS: usize = 6;
const LIVE_SLIPS: usize = 32;

/// What a stage writes down of one frame.
#[derive(Debug, Default)]
pub struct Entry {
    /// In the place of what it said here before.
    pub now: State,
    /// After what it said here before.
    pub added: State,
    /// In the place of earlier ones with the same key; one without flags is forgotten.
    pub voxels: Vec<Voxel>,
}

impl Entry {
    fn clear(&mut self) {
        self.now.clear();
        self.added.clear();
        self.voxels.clear();
    }
}

/// An entry on its way to the thread.
#[derive(Debug, Default)]
struct Slip {
    head: Head,
    /// It holds everything, and what was written before is void.
    whole: bool,
    entry: Entry,
}

/// Where a stage's journal is.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    pub(crate) folder: PathBuf,
    pub(crate) lossless: bool,
    pub(crate) max_bytes: u64,
}

/// How far an instance got that is no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ReadBack {
    /// The last frame that was written down.
    pub(crate) head: Head,
    generation: Generation,
}

/// What a journal starts with.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Start {
    /// Nothing has happened yet.
    Empty,
    /// What was read back.
    After(ReadBack),
    /// The stage took over from another instance: its first entry holds everything.
    Whole,
}

/// A stage's side of its journal.
#[derive(Debug)]
pub(crate) struct Journal {
    filled: SyncSender<Slip>,
    empty: Receiver<Slip>,
    lossless: bool,
    whole: bool,
    dropped: u64,
    folder: PathBuf,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Journal {
    /// Opens the journal and starts its thread.
    ///
    /// # Errors
    /// [`StageError::File`].
    pub(crate) fn open(place: &Place, start: Start) -> Result<Self, StageError> {
        let refused = |cause: std::io::Error| {
            StageError::File(format!(
                "{}: {cause}; choose another supervision.state_dir, or journal = false",
                place.folder.display()
            ))
        };
        std::fs::create_dir_all(&place.folder).map_err(refused)?;
        let log = match start {
            Start::Empty => Log::create_first(&place.folder),
            Start::After(read) => Log::go_on(&place.folder, read.generation),
            Start::Whole => Log::create_next(&place.folder),
        };
        let slips = if place.lossless { LOSSLESS_SLIPS } else { LIVE_SLIPS };
        let (filled, written) = sync_channel(slips);
        let (back, empty) = sync_channel(slips);
        for _ in 0..slips {
            // There is room for all.
            let _ = back.try_send(Slip::default());
        }
        let writer = Writer::new(log.map_err(refused)?, place);
        let thread = std::thread::Builder::new()
            .name("journal".to_owned())
            .spawn(move || writer.run(&written, &back))
            .map_err(refused)?;
        let whole = matches!(start, Start::Whole);
        let (lossless, folder) = (place.lossless, place.folder.clone());
        Ok(Self { filled, empty, lossless, whole, dropped: 0, folder, thread: Some(thread) })
    }

    /// Hands what `fill` says to the thread; `fill` is told whether it has to say everything. False where the journal has ended.
    pub(crate) fn write(&mut self, head: Head, fill: impl FnOnce(&mut Entry, bool)) -> bool {
        let slip = if self.lossless {
            self.empty.recv().map_err(|_| TryRecvError::Disconnected)
        } else {
            self.empty.try_recv()
        };
        match slip {
            Ok(mut slip) => {
                slip.entry.clear();
                (slip.head, slip.whole) = (head, self.whole);
                fill(&mut slip.entry, self.whole);
                self.whole = false;
                self.filled.send(slip).is_ok()
            }
            Err(TryRecvError::Empty) => {
                if self.dropped == 0 {
                    tracing::warn!(
                        folder = %self.folder.display(),
                        frame = head.seq,
                        "the disk is too slow for the journal; it goes on with the whole state when it keeps up"
                    );
                }
                self.dropped += 1;
                self.whole = true;
                true
            }
            Err(TryRecvError::Disconnected) => false,
        }
    }

    /// Entries that were dropped because the disk was too slow.
    pub(crate) fn dropped(&self) -> u64 {
        self.dropped
    }
}

impl Drop for Journal {
    /// What was said is written.
    fn drop(&mut self) {
        let (closed, _) = sync_channel(0);
        self.filled = closed;
        if let Some(thread) = self.thread.take() {
            // It has said in the log what went wrong.
            let _ = thread.join();
        }
    }
}

/// Reads what an instance that is no more has written down; `take` gets the entries in order. Nothing where there is no journal.
pub(crate) fn read_back(
    folder: &Path,
    mut take: impl FnMut(&mut Entry) -> Result<(), StageError>,
) -> Result<Option<ReadBack>, StageError> {
    let failed = |cause: std::io::Error| StageError::File(format!("{}: {cause}", folder.display()));
    let Some(mut generation) = Generation::newest(folder).map_err(failed)? else { return Ok(None) };
    let mut newest = None;
    let mut entry = Entry::default();
    for path in [generation.base(folder), generation.log(folder)] {
        let Some(mut reader) = file::Reader::open(&path).map_err(failed)? else { continue };
        while let Some(head) = reader.next(&mut entry).map_err(failed)? {
            take(&mut entry)?;
            newest = Some(head);
        }
        generation.log_bytes = reader.sound_bytes();
    }
    Ok(newest.map(|head| ReadBack { head, generation }))
}

#[cfg(test)]
mod tests;
