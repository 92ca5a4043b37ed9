//! The flat subset of YAML that map files use: `key: value`, lists in brackets or as dashes, comments, quotes.

use std::collections::BTreeMap;
use std::path::Path;

use crate::FormatError;

const REMEDY: &str = "a map file has lines `key: value` with image, resolution, origin, negate, \
    occupied_thresh, free_thresh and mode";

/// A value with the byte at which its line starts.
#[derive(Debug, Clone)]
struct Entry {
    start: u64,
    items: Vec<String>,
}

/// The keys of a map file.
pub(super) struct Keys<'a> {
    path: &'a Path,
    entries: BTreeMap<String, Entry>,
}

impl<'a> Keys<'a> {
    /// Parses a file; `path` is for messages only.
    pub(super) fn parse(bytes: &[u8], path: &'a Path) -> Result<Self, FormatError> {
        let text = std::str::from_utf8(bytes).map_err(|fault| {
            FormatError::malformed(path, fault.valid_up_to() as u64, "the text is not UTF-8", REMEDY)
        })?;
        let mut entries: BTreeMap<String, Entry> = BTreeMap::new();
        let mut open: Option<String> = None;
        let mut next = 0;
        for raw in text.split_inclusive('\n') {
            let start = next;
            next += raw.len() as u64;
            let fault = |cause: String| FormatError::malformed(path, start, cause, REMEDY);
            let line = without_comment(raw).trim();
            if line.is_empty() || line == "---" || line == "..." {
                continue;
            }
            let item = line.strip_prefix('-').filter(|rest| rest.is_empty() || rest.starts_with(' '));
            if let (Some(item), Some(key)) = (item, &open) {
                if let Some(entry) = entries.get_mut(key) {
                    entry.items.push(scalar(item).map_err(fault)?);
                }
                continue;
            }
            let Some((key, value)) = line.split_once(':') else {
                return Err(fault(format!("{line:?} is no `key: value`")));
            };
            let key = scalar(key).map_err(fault)?;
            let items = items(value.trim()).map_err(fault)?;
            open = items.is_empty().then(|| key.clone());
            if entries.insert(key.clone(), Entry { start, items }).is_some() {
                return Err(fault(format!("{key:?} appears twice")));
            }
        }
        Ok(Self { path, entries })
    }

    /// A fault of this key's value.
    pub(super) fn fault(&self, key: &str, cause: String) -> FormatError {
        FormatError::malformed(self.path, self.entries.get(key).map_or(0, |e| e.start), cause, REMEDY)
    }

    /// The single value of a key; `None` where the key is absent.
    pub(super) fn text(&self, key: &str) -> Result<Option<&str>, FormatError> {
        match self.entries.get(key).map(|entry| entry.items.as_slice()) {
            None => Ok(None),
            Some([value]) => Ok(Some(value)),
            Some(items) => {
                Err(self.fault(key, format!("{key:?} has {} values where 1 is needed", items.len())))
            }
        }
    }

    /// A finite number.
    pub(super) fn number(&self, key: &str) -> Result<Option<f64>, FormatError> {
        self.text(key)?.map(|word| self.parse_number(key, word)).transpose()
    }

    /// A list of three finite numbers.
    pub(super) fn three(&self, key: &str) -> Result<Option<[f64; 3]>, FormatError> {
        match self.entries.get(key).map(|entry| entry.items.as_slice()) {
            None => Ok(None),
            Some([a, b, c]) => {
                let number = |word: &str| self.parse_number(key, word);
                Ok(Some([number(a)?, number(b)?, number(c)?]))
            }
            Some(items) => {
                Err(self.fault(key, format!("{key:?} has {} values where 3 are needed", items.len())))
            }
        }
    }

    /// The value of a key that must be there.
    pub(super) fn needed<T>(&self, key: &str, value: Option<T>) -> Result<T, FormatError> {
        value.ok_or_else(|| self.fault(key, format!("there is no {key:?}")))
    }

    fn parse_number(&self, key: &str, word: &str) -> Result<f64, FormatError> {
        let number = word.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.fault(key, format!("{key:?} is {word:?} where a number is needed")))
    }
}

/// Cuts a comment: `#` at the start or after white space, outside quotes.
fn without_comment(line: &str) -> &str {
    let (mut quote, mut before) = (None, ' ');
    for (at, c) in line.char_indices() {
        match quote {
            Some(open) if c == open => quote = None,
            None if c == '"' || c == '\'' => quote = Some(c),
            None if c == '#' && before.is_whitespace() => return line.get(..at).unwrap_or(line),
            _ => {}
        }
        before = c;
    }
    line
}

fn items(value: &str) -> Result<Vec<String>, String> {
    if value.is_empty() {
        return Ok(Vec::new());
    }
    let Some(list) = value.strip_prefix('[') else { return Ok(vec![scalar(value)?]) };
    let list =
        list.strip_suffix(']').ok_or_else(|| format!("the list {value:?} is not closed on its line"))?;
    list.split(',').map(scalar).collect()
}

fn scalar(text: &str) -> Result<String, String> {
    let text = text.trim();
    for quote in ['"', '\''] {
        if let Some(rest) = text.strip_prefix(quote) {
            let inner = rest.strip_suffix(quote).filter(|inner| !inner.contains([quote, '\\']));
            return inner.map(str::to_owned).ok_or_else(|| format!("the quotes of {text} cannot be read"));
        }
    }
    if text.starts_with(['{', '[', '&', '*', '!', '|', '>', '%', '@', '`']) {
        return Err(format!("{text:?} is beyond the plain YAML of a map file"));
    }
    Ok(text.to_owned())
}
