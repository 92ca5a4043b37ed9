//! The rows of a table, in the order of their numbers: a B-tree whose leaves hold the rows, long rows going on in chains
//! of overflow pages.

use super::pages::Database;
use super::record::{Value, values, varint};
use crate::FormatError;

/// Levels of a tree; eight hold more rows than a disk.
const MAX_DEPTH: usize = 20;
/// Longer definitions of tables are none.
const MAX_DEFINITION: usize = 1 << 16;

/// A walk over a table's rows.
#[derive(Debug)]
pub(crate) struct Table {
    /// The pages from the root to the one at hand.
    stack: Vec<Page>,
    /// Pages that were entered; more than the file has is a loop.
    entered: u64,
    /// Buffers of pages that were left.
    spare: Vec<Vec<u8>>,
}

#[derive(Debug)]
struct Page {
    number: u32,
    bytes: Vec<u8>,
    /// Where its header begins: behind the file's own on page 1.
    header: usize,
    is_leaf: bool,
    cells: usize,
    next: usize,
}

/// A row, of which only the part that lies in its leaf was read.
#[derive(Debug)]
pub(crate) struct Row {
    /// Its number, which is also its `INTEGER PRIMARY KEY`.
    pub(crate) number: i64,
    /// Where its leaf begins in the file.
    pub(crate) offset: u64,
    length: usize,
    local: usize,
    /// First page of the rest.
    overflow: u32,
}

impl Table {
    /// The table of that name; `None` if there is none.
    ///
    /// # Errors
    /// [`FormatError`] for a damaged file.
    pub(crate) fn find(database: &Database, name: &str) -> Result<Option<Self>, FormatError> {
        let (mut schema, mut bytes) = (Self::at(database, 1)?, Vec::new());
        while let Some(row) = schema.next_row(database, &mut bytes)? {
            if row.length > MAX_DEFINITION {
                continue;
            }
            row.read_all(database, &mut bytes)?;
            // type, name, tbl_name, rootpage
            let Some([kind, own, _, root]) = values::<4>(&bytes, row.length) else {
                return Err(database.damaged(row.offset, "the definition of a table is damaged"));
            };
            let text = |value: &Value| value.bytes().and_then(|range| bytes.get(range));
            if text(&kind) == Some(b"table") && text(&own) == Some(name.as_bytes()) {
                let root = root.integer().and_then(|root| u32::try_from(root).ok()).unwrap_or_default();
                return Self::at(database, root).map(Some);
            }
        }
        Ok(None)
    }

    fn at(database: &Database, root: u32) -> Result<Self, FormatError> {
        let mut table = Self { stack: Vec::new(), entered: 0, spare: Vec::new() };
        table.enter(database, root)?;
        Ok(table)
    }

    /// The next row, `None` after the last; its first bytes replace those in `bytes`.
    ///
    /// # Errors
    /// [`FormatError`] for a damaged page.
    pub(crate) fn next_row(
        &mut self,
        database: &Database,
        bytes: &mut Vec<u8>,
    ) -> Result<Option<Row>, FormatError> {
        while let Some(page) = self.stack.last_mut() {
            let cell = page.next;
            // An inner page has one child more than cells.
            if cell >= page.cells + usize::from(!page.is_leaf) {
                let left = self.stack.pop().map(|page| page.bytes);
                self.spare.extend(left);
                continue;
            }
            page.next += 1;
            let damaged =
                |page: &Page| database.damaged(database.offset(page.number), "the page's cells are damaged");
            if page.is_leaf {
                let row = page.row(database, cell, bytes).ok_or_else(|| damaged(page))?;
                return Ok(Some(row));
            }
            let child = page.child(cell).ok_or_else(|| damaged(page))?;
            self.enter(database, child)?;
        }
        Ok(None)
    }

    fn enter(&mut self, database: &Database, number: u32) -> Result<(), FormatError> {
        self.entered += 1;
        if self.stack.len() == MAX_DEPTH || self.entered > database.pages {
            return Err(database.damaged(database.offset(number), "the table's pages go round in a loop"));
        }
        let mut bytes = self.spare.pop().unwrap_or_default();
        bytes.clear();
        database.append(number, 0, usize::MAX, &mut bytes)?;
        let page = Page::parse(number, bytes)
            .ok_or_else(|| database.damaged(database.offset(number), "the page is none of a table"))?;
        self.stack.push(page);
        Ok(())
    }
}

impl Page {
    fn parse(number: u32, bytes: Vec<u8>) -> Option<Self> {
        let header = if number == 1 { 100 } else { 0 };
        let is_leaf = match bytes.get(header)? {
            0x05 => false,
            0x0d => true,
            _ => return None,
        };
        let cells = usize::from(u16_at(&bytes, header + 3)?);
        Some(Self { number, bytes, header, is_leaf, cells, next: 0 })
    }

    /// Bytes of a cell and all that follow it.
    fn cell(&self, index: usize) -> Option<&[u8]> {
        let pointers = self.header + if self.is_leaf { 8 } else { 12 };
        self.bytes.get(usize::from(u16_at(&self.bytes, pointers + 2 * index)?)..)
    }

    /// Child `index` of an inner page; the last is in its header.
    fn child(&self, index: usize) -> Option<u32> {
        let bytes = if index == self.cells { self.bytes.get(self.header + 8..)? } else { self.cell(index)? };
        bytes.first_chunk().map(|bytes| u32::from_be_bytes(*bytes))
    }

    fn row(&self, database: &Database, index: usize, out: &mut Vec<u8>) -> Option<Row> {
        let cell = self.cell(index)?;
        let (length, size) = varint(cell)?;
        let cell = cell.get(size..)?;
        let (number, size) = varint(cell)?;
        let cell = cell.get(size..)?;
        let length = usize::try_from(length).ok()?;
        // No row is longer than its file.
        if length as u64 > database.pages.checked_mul(database.usable as u64)? {
            return None;
        }
        let local = local_bytes(length, database.usable);
        let overflow =
            if local < length { u32::from_be_bytes(*cell.get(local..)?.first_chunk()?) } else { 0 };
        out.clear();
        out.extend_from_slice(cell.get(..local)?);
        let offset = database.offset(self.number);
        Some(Row { number: number.cast_signed(), offset, length, local, overflow })
    }
}

/// Bytes of a row of `length` that lie in its leaf.
fn local_bytes(length: usize, usable: usize) -> usize {
    let most = usable - 35;
    if length <= most {
        return length;
    }
    let least = (usable - 12) * 32 / 255 - 23;
    let fitting = least + (length - least) % (usable - 4);
    if fitting <= most { fitting } else { least }
}

impl Row {
    /// Its first `N` values, of the bytes that [`Table::next_row`] has read; texts and blobs may be longer than these.
    pub(crate) fn values<const N: usize>(&self, bytes: &[u8]) -> Option<[Value; N]> {
        values(bytes, self.length)
    }

    /// Completes the row's bytes.
    ///
    /// # Errors
    /// [`FormatError`] for a damaged chain of pages.
    pub(crate) fn read_all(&self, database: &Database, bytes: &mut Vec<u8>) -> Result<(), FormatError> {
        bytes.truncate(self.local);
        let mut page = self.overflow;
        while bytes.len() < self.length {
            let at = bytes.len();
            database.append(page, 0, 4 + self.length - at, bytes)?;
            let next = bytes.get(at..).and_then(<[u8]>::first_chunk).map(|next| u32::from_be_bytes(*next));
            bytes.drain(at..at + 4);
            let damaged = || database.damaged(database.offset(page), "the row's chain of pages is damaged");
            page = next.ok_or_else(damaged)?;
        }
        Ok(())
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|bytes| u16::from_be_bytes(*bytes))
}
