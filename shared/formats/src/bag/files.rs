//! A bag of any kind: one file, or a folder of files that follow each other.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::db3::{Db3Index, Db3Reader};
use super::{BagMessage, BagReader, Connection, FileIndex, Found};
use crate::FormatError;
use crate::mcap::McapIndex;
use crate::rosbag::BagIndex;

/// What a ROS 2 bag's folder says about itself.
const METADATA: &str = "metadata.yaml";
/// Larger descriptions are none.
const MAX_METADATA: u64 = 4 << 20;

/// The connections and files of a bag: ROS 1, MCAP (ROS 2, and evac's own recordings) or db3 (ROS 2). A folder is one bag:
/// the files that its `metadata.yaml` names, or all MCAP or db3 files in the order of their names.
#[derive(Debug, Clone)]
pub struct Bag {
    path: PathBuf,
    parts: Arc<[Part]>,
    connections: Vec<Connection>,
}

#[derive(Debug)]
struct Part {
    index: Index,
    /// Number of a connection in the whole bag, by its place among the file's own connections.
    numbers: Vec<u32>,
}

#[derive(Debug)]
enum Index {
    Chunked(FileIndex),
    Db3(Db3Index),
}

impl Bag {
    /// Reads the structure of all files. Those that are cut off are refused, or with `allow_truncated` taken up to where
    /// they end.
    ///
    /// # Errors
    /// [`FormatError`] naming the file, the place in it and what to try.
    pub fn open(path: &Path, allow_truncated: bool) -> Result<Self, FormatError> {
        let mut parts = Vec::new();
        let mut connections = Vec::new();
        for file in files_of(path)? {
            let index = Index::read(&file, allow_truncated)?;
            let numbers = index.connections().iter().map(|own| number(&mut connections, own)).collect();
            parts.push(Part { index, numbers });
        }
        Ok(Self { path: path.to_owned(), parts: parts.into(), connections })
    }

    /// The bag, as it was named.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// All connections; a topic's messages of all files are counted together.
    pub fn connections(&self) -> &[Connection] {
        &self.connections
    }

    /// Files that are cut off, and where their usable part ends.
    pub fn truncated(&self) -> impl Iterator<Item = (&Path, u64)> {
        self.parts.iter().filter_map(|part| Some((part.index.path(), part.index.truncated_at()?)))
    }
}

/// The number of a file's connection in the whole bag; its messages are added.
fn number(connections: &mut Vec<Connection>, own: &Connection) -> u32 {
    let same = |known: &Connection| {
        (&known.topic, &known.type_name, known.encoding) == (&own.topic, &own.type_name, own.encoding)
    };
    let at = connections.iter().position(same).unwrap_or(connections.len());
    match connections.get_mut(at) {
        Some(known) => known.messages += own.messages,
        None => connections.push(Connection { id: at as u32, ..own.clone() }),
    }
    at as u32
}

impl Index {
    fn read(path: &Path, allow_truncated: bool) -> Result<Self, FormatError> {
        let mut magic = Vec::with_capacity(16);
        File::open(path)
            .and_then(|file| file.take(16).read_to_end(&mut magic))
            .map_err(|cause| FormatError::reading(path, cause))?;
        match magic.as_slice() {
            [0x89, b'M', b'C', b'A', b'P', ..] => McapIndex::read(path, allow_truncated).map(Self::Chunked),
            [b'S', b'Q', b'L', b'i', b't', b'e', ..] => Db3Index::read(path, allow_truncated).map(Self::Db3),
            // What else it may be is said by the reader of ROS 1 bags.
            _ => BagIndex::read(path, allow_truncated).map(Self::Chunked),
        }
    }

    fn path(&self) -> &Path {
        match self {
            Self::Chunked(index) => index.path(),
            Self::Db3(index) => index.path(),
        }
    }

    fn connections(&self) -> &[Connection] {
        match self {
            Self::Chunked(index) => index.connections(),
            Self::Db3(index) => index.connections(),
        }
    }

    fn truncated_at(&self) -> Option<u64> {
        match self {
            Self::Chunked(index) => index.truncated_at(),
            Self::Db3(index) => index.truncated_at(),
        }
    }

    fn messages(&self, wanted: &[u32]) -> Result<FileReader, FormatError> {
        Ok(match self {
            Self::Chunked(index) => FileReader::Chunked(index.messages(wanted)?),
            Self::Db3(index) => FileReader::Db3(index.messages(wanted)?),
        })
    }
}

/// The messages of one file.
#[derive(Debug)]
enum FileReader {
    Chunked(BagReader),
    Db3(Db3Reader),
}

impl FileReader {
    fn find(&mut self) -> Result<Option<Found>, FormatError> {
        match self {
            Self::Chunked(reader) => reader.find(),
            Self::Db3(reader) => reader.find(),
        }
    }

    fn message(&self, found: &Found) -> BagMessage<'_> {
        match self {
            Self::Chunked(reader) => reader.message(found),
            Self::Db3(reader) => reader.message(found),
        }
    }
}

/// Streams the messages of chosen connections, file after file, see [`BagReader`].
#[derive(Debug)]
pub struct Messages {
    parts: Arc<[Part]>,
    wanted: Vec<u32>,
    /// The file at hand, and its reader once it is open.
    current: usize,
    reader: Option<FileReader>,
}

impl Messages {
    /// Messages of the connections `wanted`.
    pub fn new(bag: &Bag, wanted: &[u32]) -> Self {
        Self { parts: Arc::clone(&bag.parts), wanted: wanted.to_vec(), current: 0, reader: None }
    }

    /// The file that the last message came from; after the last, the last file.
    pub fn path(&self) -> &Path {
        self.parts.get(self.current).or(self.parts.last()).map_or(Path::new(""), |part| part.index.path())
    }

    /// The next message, `None` after the last. Its connection is the number in the whole bag.
    ///
    /// # Errors
    /// [`FormatError`] naming the file and the place of the damage.
    pub fn next_message(&mut self) -> Result<Option<BagMessage<'_>>, FormatError> {
        let Some(found) = self.find()? else { return Ok(None) };
        Ok(self.reader.as_ref().map(|reader| {
            let message = reader.message(&found);
            BagMessage { connection: self.number_of(message.connection), ..message }
        }))
    }

    fn find(&mut self) -> Result<Option<Found>, FormatError> {
        while let Some(part) = self.parts.get(self.current) {
            if self.reader.is_none() {
                let ids = part.index.connections().iter().zip(&part.numbers);
                let wanted: Vec<_> =
                    ids.filter(|(_, number)| self.wanted.contains(number)).map(|(own, _)| own.id).collect();
                self.reader = Some(part.index.messages(&wanted)?);
            }
            let found = self.reader.as_mut().map(FileReader::find).transpose()?.flatten();
            if found.is_some() {
                return Ok(found);
            }
            self.reader = None;
            self.current += 1;
        }
        Ok(None)
    }

    fn number_of(&self, own: u32) -> u32 {
        let part = self.parts.get(self.current);
        let at = part.and_then(|part| part.index.connections().iter().position(|known| known.id == own));
        part.zip(at).and_then(|(part, at)| part.numbers.get(at)).copied().unwrap_or(own)
    }
}

/// The files of a bag, in order.
fn files_of(path: &Path) -> Result<Vec<PathBuf>, FormatError> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let metadata = path.join(METADATA);
    let files = if metadata.exists() { named_in(&metadata, path)? } else { found_in(path)? };
    if files.is_empty() {
        let cause = "the folder holds no recording: neither metadata.yaml with files nor *.mcap or *.db3";
        return Err(FormatError::malformed(path, 0, cause, "name the recording itself"));
    }
    Ok(files)
}

/// The list `relative_file_paths` of a ROS 2 bag. Only this much of YAML is read, as rosbag2 writes it.
fn named_in(metadata: &Path, folder: &Path) -> Result<Vec<PathBuf>, FormatError> {
    let mut text = String::new();
    File::open(metadata)
        .and_then(|file| file.take(MAX_METADATA).read_to_string(&mut text))
        .map_err(|cause| FormatError::reading(metadata, cause))?;
    let lines = text.lines().map(str::trim);
    let compression = lines.clone().find_map(|line| line.strip_prefix("compression_mode:"));
    if let Some(mode) =
        compression.map(unquoted).filter(|mode| !mode.is_empty() && !mode.eq_ignore_ascii_case("none"))
    {
        let cause = format!("the bag is compressed by {}, which is read by ROS only", mode.to_lowercase());
        let remedy = "write it uncompressed with `ros2 bag convert`";
        return Err(FormatError::malformed(metadata, 0, cause, remedy));
    }
    let list = lines.skip_while(|line| *line != "relative_file_paths:").skip(1);
    let names = list.map_while(|line| line.strip_prefix("- ")).map(unquoted);
    // Old versions name the folder too.
    Ok(names.filter_map(|name| Some(folder.join(Path::new(name).file_name()?))).collect())
}

fn unquoted(value: &str) -> &str {
    value.trim().trim_matches(['"', '\''])
}

/// All MCAP or db3 files of a folder; numbers at their ends count as numbers.
fn found_in(folder: &Path) -> Result<Vec<PathBuf>, FormatError> {
    let failed = |cause| FormatError::reading(folder, cause);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|extension| extension == "mcap" || extension == "db3") {
            files.push(path);
        }
    }
    files.sort_by_cached_key(|path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        let number = stem[name.len()..].parse::<u64>().unwrap_or_default();
        (name.to_owned(), number)
    });
    Ok(files)
}
