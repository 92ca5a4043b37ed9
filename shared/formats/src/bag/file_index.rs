//! What one file holds whose messages lie in chunks: a ROS 1 bag or an MCAP file.

use std::path::{Path, PathBuf};

use super::chunk::Chunk;
use super::chunk_reader::Split;
use super::{BagReader, Connection};
use crate::FormatError;

/// A robot has tens of topics; so many are a damaged or hostile file, and would take long to look up.
const MAX_CONNECTIONS: usize = 4096;

/// The connections and chunks of a file. Its memory grows with the number of chunks (a few hundred bytes each), not with
/// their size.
#[derive(Debug, Clone)]
pub struct FileIndex {
    pub(crate) path: PathBuf,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) connections: Vec<Connection>,
    pub(crate) truncated_at: Option<u64>,
    pub(crate) split: Split,
}

impl FileIndex {
    /// Of a file whose records `split` takes apart; nothing is known of it yet.
    pub(crate) fn new(path: &Path, split: Split) -> Self {
        Self { path: path.to_owned(), chunks: Vec::new(), connections: Vec::new(), truncated_at: None, split }
    }

    /// All connections, by id.
    pub fn connections(&self) -> &[Connection] {
        &self.connections
    }

    /// Where the usable part ends, for a file that is cut off.
    pub fn truncated_at(&self) -> Option<u64> {
        self.truncated_at
    }

    /// Streams the messages of the connections `wanted`.
    ///
    /// # Errors
    /// [`FormatError::Io`] if the file cannot be opened again.
    pub fn messages(&self, wanted: &[u32]) -> Result<BagReader, FormatError> {
        BagReader::new(self, wanted)
    }

    /// The file, as it was named.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a connection that is not known yet.
    pub(crate) fn add(&mut self, connection: Connection) -> Result<(), String> {
        if self.connections.iter().any(|known| known.id == connection.id) {
            return Ok(());
        }
        if self.connections.len() == MAX_CONNECTIONS {
            return Err(format!("there are more than {MAX_CONNECTIONS} topics"));
        }
        self.connections.push(connection);
        Ok(())
    }

    /// Everything has been found: puts connections in order and counts their messages.
    pub(crate) fn counted(mut self) -> Self {
        self.connections.sort_by_key(|connection| connection.id);
        for (id, count) in self.chunks.iter().flat_map(|chunk| &chunk.counts) {
            let at = self.connections.binary_search_by_key(id, |connection| connection.id);
            if let Some(connection) = at.ok().and_then(|at| self.connections.get_mut(at)) {
                connection.messages += count;
            }
        }
        self
    }
}
