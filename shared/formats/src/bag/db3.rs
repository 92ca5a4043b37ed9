//! ROS 2 bags of kind db3: an SQLite database with the tables `topics` and `messages`, as rosbag2 makes them.

use std::collections::BTreeMap;
use std::path::Path;

use super::{BagMessage, Connection, Found};
use crate::FormatError;
use crate::ros::Encoding;
use crate::sqlite::{Database, Row, Table};

/// A robot has tens of topics; so many are a damaged or hostile file.
const MAX_TOPICS: usize = 4096;
const DAMAGED: &str = "copy it again, or repair it with `sqlite3 FILE .recover`";

/// The topics of a bag and how many messages each has.
#[derive(Debug)]
pub(super) struct Db3Index {
    database: Database,
    connections: Vec<Connection>,
    truncated_at: Option<u64>,
}

impl Db3Index {
    /// Goes over all rows, without their data.
    pub(super) fn read(path: &Path, allow_truncated: bool) -> Result<Self, FormatError> {
        let database = Database::open(path)?;
        if let Some(beside) = database.unmerged().filter(|_| !allow_truncated) {
            let cause =
                format!("the recorder did not end properly: {} holds more messages", beside.display());
            let remedy = "move them in with `sqlite3 FILE 'pragma wal_checkpoint(truncate)'`, or use what is in the \
                          file with --allow-truncated";
            return Err(FormatError::malformed(path, 0, cause, remedy));
        }
        let mut index = Self { connections: topics(&database)?, database, truncated_at: None };
        let mut reader = Db3Reader::open(path, &[], None)?;
        let mut counts = BTreeMap::<u32, u64>::new();
        loop {
            match reader.next() {
                Ok(Some((topic, _))) => *counts.entry(topic).or_default() += 1,
                Ok(None) => break,
                Err(failure) if !allow_truncated => return Err(failure),
                Err(_) => {
                    index.truncated_at = Some(reader.offset);
                    break;
                }
            }
        }
        for connection in &mut index.connections {
            connection.messages = counts.get(&connection.id).copied().unwrap_or_default();
        }
        Ok(index)
    }

    pub(super) fn path(&self) -> &Path {
        self.database.path()
    }

    pub(super) fn connections(&self) -> &[Connection] {
        &self.connections
    }

    pub(super) fn truncated_at(&self) -> Option<u64> {
        self.truncated_at
    }

    pub(super) fn messages(&self, wanted: &[u32]) -> Result<Db3Reader, FormatError> {
        let ids = self.connections.iter().filter(|connection| wanted.contains(&connection.id));
        let left = self.truncated_at.map(|_| self.connections.iter().map(|c| c.messages).sum());
        let wanted: Vec<_> = ids.map(|connection| connection.id).collect();
        Db3Reader::open(self.path(), &wanted, left)
    }
}

fn missing(path: &Path, table: &str) -> FormatError {
    let cause = format!("the database has no table `{table}`, so it is no ROS 2 bag");
    FormatError::malformed(path, 0, cause, "name the bag's folder or its .db3 file")
}

fn topics(database: &Database) -> Result<Vec<Connection>, FormatError> {
    let path = database.path();
    let mut table = Table::find(database, "topics")?.ok_or_else(|| missing(path, "topics"))?;
    let (mut connections, mut bytes) = (Vec::new(), Vec::new());
    while let Some(row) = table.next_row(database, &mut bytes)? {
        row.read_all(database, &mut bytes)?;
        let damaged = || FormatError::malformed(path, row.offset, "a row of `topics` is damaged", DAMAGED);
        // id, name, type, serialization_format
        let [_, name, kind, format] = row.values::<4>(&bytes).ok_or_else(damaged)?;
        let text = |value: &crate::sqlite::Value| {
            Some(String::from_utf8_lossy(bytes.get(value.bytes()?)?).into_owned())
        };
        let (Some(topic), Some(type_name), Some(format)) = (text(&name), text(&kind), text(&format)) else {
            return Err(damaged());
        };
        if connections.len() == MAX_TOPICS {
            return Err(FormatError::malformed(path, row.offset, "there are too many topics", DAMAGED));
        }
        if format == "cdr" {
            let id = u32::try_from(row.number).map_err(|_| damaged())?;
            let (encoding, metadata) = (Encoding::Cdr, BTreeMap::new());
            connections.push(Connection { id, topic, type_name, encoding, metadata, messages: 0 });
        }
    }
    Ok(connections)
}

/// Streams messages in the order in which they were written. Memory holds one message and one page of each level.
#[derive(Debug)]
pub(super) struct Db3Reader {
    database: Database,
    messages: Table,
    wanted: Vec<u32>,
    /// Rows that may still be read, of a bag that is cut off.
    left: Option<u64>,
    row: Vec<u8>,
    /// Page of the row that was read last.
    offset: u64,
}

impl Db3Reader {
    fn open(path: &Path, wanted: &[u32], left: Option<u64>) -> Result<Self, FormatError> {
        let database = Database::open(path)?;
        let messages = Table::find(&database, "messages")?.ok_or_else(|| missing(path, "messages"))?;
        Ok(Self { database, messages, wanted: wanted.to_vec(), left, row: Vec::new(), offset: 0 })
    }

    /// Goes to the next message of a wanted topic.
    pub(super) fn find(&mut self) -> Result<Option<Found>, FormatError> {
        while self.left != Some(0) {
            let Some((connection, row)) = self.next()? else { break };
            self.left = self.left.map(|left| left - 1);
            if !self.wanted.contains(&connection) {
                continue;
            }
            row.read_all(&self.database, &mut self.row)?;
            // id, topic_id, timestamp, data
            let values = row.values::<4>(&self.row);
            let found = values.and_then(|[_, _, time, data]| Some((time.integer()?, data.bytes()?)));
            let (time_ns, data) = found.ok_or_else(|| self.damaged())?;
            return Ok(Some(Found { connection, time_ns, data, offset: row.offset }));
        }
        Ok(None)
    }

    /// The message that [`Self::find`] has found last.
    pub(super) fn message(&self, found: &Found) -> BagMessage<'_> {
        let Found { connection, time_ns, ref data, offset } = *found;
        BagMessage { connection, time_ns, data: self.row.get(data.clone()).unwrap_or_default(), offset }
    }

    /// The next row and its topic, without its data.
    fn next(&mut self) -> Result<Option<(u32, Row)>, FormatError> {
        let Some(row) = self.messages.next_row(&self.database, &mut self.row)? else { return Ok(None) };
        self.offset = row.offset;
        let topic = row.values::<2>(&self.row).and_then(|[_, topic]| u32::try_from(topic.integer()?).ok());
        let topic = topic.ok_or_else(|| self.damaged())?;
        Ok(Some((topic, row)))
    }

    fn damaged(&self) -> FormatError {
        let path = self.database.path();
        FormatError::malformed(path, self.offset, "a row of `messages` is damaged", DAMAGED)
    }
}
