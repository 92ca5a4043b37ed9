//! The files of a journal: `base-N` holds everything up to some frame, `log-N` what came after it. Number N + 1 replaces N in one step,
//! by the renaming of its base.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};

use evac_frames::Voxel;

use super::Entry;

const MAGIC: u32 = u32::from_le_bytes(*b"EVJ1");
const HEAD_BYTES: usize = 40;

/// What an entry says of itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Head {
    /// The frame after which it holds.
    pub(crate) seq: u64,
    /// See [`crate::StageOutput::lineage`].
    pub(crate) lineage: u32,
}

/// A base and its log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Generation {
    number: u64,
    /// Bytes of the log that are whole.
    pub(super) log_bytes: u64,
}

impl Generation {
    /// The newest in a folder.
    pub(super) fn newest(folder: &Path) -> io::Result<Option<Self>> {
        let mut newest = None;
        let entries = match fs::read_dir(folder) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            entries => entries?,
        };
        for entry in entries {
            let name = entry?.file_name();
            let name = name.to_string_lossy();
            // A base that was not finished has another name.
            let number = name.strip_prefix("base-").or_else(|| name.strip_prefix("log-"));
            newest = newest.max(number.and_then(|number| number.parse().ok()));
        }
        Ok(newest.map(|number| Self { number, log_bytes: 0 }))
    }

    pub(super) fn base(&self, folder: &Path) -> PathBuf {
        folder.join(format!("base-{}", self.number))
    }

    pub(super) fn log(&self, folder: &Path) -> PathBuf {
        folder.join(format!("log-{}", self.number))
    }

    fn next(self) -> Self {
        Self { number: self.number + 1, log_bytes: 0 }
    }
}

/// The log that is written.
#[derive(Debug)]
pub(super) struct Log {
    folder: PathBuf,
    pub(super) generation: Generation,
    file: File,
    /// One entry's bytes.
    buffer: Vec<u8>,
    dirty: bool,
}

impl Log {
    /// The first of a folder, which is emptied.
    pub(super) fn create_first(folder: &Path) -> io::Result<Self> {
        clear(folder, None)?;
        Self::create(folder, Generation { number: 0, log_bytes: 0 })
    }

    /// One that has no base yet, after all that are there.
    pub(super) fn create_next(folder: &Path) -> io::Result<Self> {
        let newest = Generation::newest(folder)?;
        // What is there stays until the first base is written. The file of this one has a number that nobody reads.
        let unread = Generation { number: newest.map_or(0, |newest| newest.number + 1), log_bytes: 0 };
        let file = File::create(folder.join("log.new"))?;
        Ok(Self { folder: folder.to_owned(), generation: unread, file, buffer: Vec::new(), dirty: false })
    }

    /// Goes on after the last whole entry.
    pub(super) fn go_on(folder: &Path, generation: Generation) -> io::Result<Self> {
        let file = OpenOptions::new().create(true).append(true).open(generation.log(folder))?;
        file.set_len(generation.log_bytes)?;
        Ok(Self { folder: folder.to_owned(), generation, file, buffer: Vec::new(), dirty: true })
    }

    fn create(folder: &Path, generation: Generation) -> io::Result<Self> {
        let file = OpenOptions::new().create(true).append(true).open(generation.log(folder))?;
        Ok(Self { folder: folder.to_owned(), generation, file, buffer: Vec::new(), dirty: false })
    }

    /// Writes an entry with one call, so that of a killed process it is there or torn off at the end.
    pub(super) fn write(&mut self, head: Head, entry: &Entry) -> io::Result<()> {
        self.buffer.clear();
        encode(head, entry, &mut self.buffer);
        self.file.write_all(&self.buffer)?;
        self.generation.log_bytes += self.buffer.len() as u64;
        self.dirty = true;
        Ok(())
    }

    /// Brings what was written to the disk.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        if std::mem::take(&mut self.dirty) { self.file.sync_data() } else { Ok(()) }
    }

    pub(super) fn base(&self) -> PathBuf {
        self.generation.base(&self.folder)
    }

    pub(super) fn log(&self) -> PathBuf {
        self.generation.log(&self.folder)
    }

    /// Begins the next generation with the base that `write` writes.
    pub(super) fn rotate(&mut self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
        let next = self.generation.next();
        let unfinished = self.folder.join("base.new");
        let mut writer = io::BufWriter::new(File::create(&unfinished)?);
        write(&mut writer)?;
        writer.flush()?;
        writer.get_ref().sync_all()?;
        fs::rename(&unfinished, next.base(&self.folder))?;
        *self = Self { buffer: std::mem::take(&mut self.buffer), ..Self::create(&self.folder, next)? };
        clear(&self.folder, Some(next))
    }
}

/// Removes all generations but one.
fn clear(folder: &Path, but: Option<Generation>) -> io::Result<()> {
    let kept = but.map(|generation| [generation.base(folder), generation.log(folder)]);
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let is_ours = name.starts_with("base") || name.starts_with("log");
        if is_ours && !kept.as_ref().is_some_and(|kept| kept.contains(&path)) {
            fs::remove_file(&path)?;
        }
    }
    Ok(())
}

/// One entry's bytes.
pub(super) fn encode(head: Head, entry: &Entry, bytes: &mut Vec<u8>) {
    let start = bytes.len();
    let voxels: &[u8] = bytemuck::cast_slice(&entry.voxels);
    let [now, added] = [entry.now.bytes(), entry.added.bytes()];
    bytes.extend(MAGIC.to_le_bytes());
    bytes.extend(0_u32.to_le_bytes());
    bytes.extend(head.seq.to_le_bytes());
    bytes.extend(u64::from(head.lineage).to_le_bytes());
    for part in [now.len(), added.len(), voxels.len(), 0] {
        bytes.extend((part as u32).to_le_bytes());
    }
    for part in [now, added, voxels] {
        bytes.extend_from_slice(part);
    }
    let crc = crc32fast::hash(bytes.get(start + 8..).unwrap_or_default());
    if let Some(place) = bytes.get_mut(start + 4..start + 8) {
        place.copy_from_slice(&crc.to_le_bytes());
    }
}

/// Reads entries until the first that is not whole.
#[derive(Debug)]
pub(super) struct Reader {
    reader: BufReader<File>,
    left: u64,
    sound: u64,
    bytes: Vec<u8>,
}

impl Reader {
    /// Nothing where there is no such file.
    pub(super) fn open(path: &Path) -> io::Result<Option<Self>> {
        let file = match File::open(path) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            file => file?,
        };
        let left = file.metadata()?.len();
        Ok(Some(Self { reader: BufReader::new(file), left, sound: 0, bytes: Vec::new() }))
    }

    /// Bytes of the entries that were read.
    pub(super) fn sound_bytes(&self) -> u64 {
        self.sound
    }

    /// The next entry, in the place of the old one's content.
    pub(super) fn next(&mut self, entry: &mut Entry) -> io::Result<Option<Head>> {
        entry.clear();
        let mut head = [0_u8; HEAD_BYTES];
        if self.left < HEAD_BYTES as u64 {
            return Ok(None);
        }
        self.reader.read_exact(&mut head)?;
        self.left -= HEAD_BYTES as u64;
        let word = |at: usize| {
            head.get(at..at + 4)
                .and_then(|word| word.first_chunk())
                .map_or(0, |word| u32::from_le_bytes(*word))
        };
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        let [now, added, voxels] = [24, 28, 32].map(|at| word(at) as usize);
        let size = now as u64 + added as u64 + voxels as u64;
        if word(0) != MAGIC || size > self.left || voxels % size_of::<Voxel>() != 0 {
            return Ok(None);
        }
        self.bytes.resize(size as usize, 0);
        self.reader.read_exact(&mut self.bytes)?;
        self.left -= size;
        let mut crc = crc32fast::Hasher::new();
        crc.update(head.get(8..).unwrap_or_default());
        crc.update(&self.bytes);
        if crc.finalize() != word(4) {
            return Ok(None);
        }
        let (now, rest) = self.bytes.split_at(now);
        let (added, voxels) = rest.split_at(added);
        entry.now.set_bytes(now);
        entry.added.set_bytes(added);
        entry
            .voxels
            .extend(voxels.chunks_exact(size_of::<Voxel>()).map(bytemuck::pod_read_unaligned::<Voxel>));
        self.sound += HEAD_BYTES as u64 + size;
        Ok(Some(Head { seq: long(8), lineage: word(16) }))
    }
}
