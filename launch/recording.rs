//! Where a recorder that is started again goes on: in a folder beside the first part's, which stays as it is.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use evac_config::StageEntry;
use evac_formats::utc_name;
use evac_recorder::{Recorder, RecorderConfig};
use evac_stage::Stage as _;
use toml::Value;

/// The entry by which a stage is started again: a recorder's with the name of a folder that does not exist yet, `walk-1` after `walk`;
/// any other's as it is. Says where the second part will be.
pub(crate) fn beside(entry: &StageEntry) -> StageEntry {
    let mut entry = entry.clone();
    // Another executable may have a configuration of its own; it then has to find a place itself.
    let Some(config) = recorder_config(&entry) else { return entry };
    let name = free_name(&config.output_dir, config.name.as_deref());
    tracing::warn!(
        stage = entry.name(),
        "the recording goes on in {}; the part before it stays, to be read with --allow-truncated",
        config.output_dir.join(&name).display()
    );
    entry.config.insert("name".to_owned(), Value::from(name));
    entry
}

fn recorder_config(entry: &StageEntry) -> Option<RecorderConfig> {
    if entry.kind == Recorder::NAME { entry.typed_config().ok() } else { None }
}

/// A name that no recording in the folder has: the first one's with a number, or the date and time as a recorder would choose.
fn free_name(folder: &Path, first: Option<&str>) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let base = first.map_or_else(|| utc_name(now.cast_signed()), str::to_owned);
    let is_free = |name: &String| !folder.join(name).exists();
    let numbered = (1_u64..).map(|number| format!("{base}-{number}")).find(is_free);
    // The endless row of numbers has a free one.
    numbered.unwrap_or(base)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_second_part_has_a_name_that_is_not_taken_and_any_other_stage_stays_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let mut entry = StageEntry::of_kind("recorder");
        entry.config.insert("output_dir".to_owned(), Value::from(folder.path().to_str().unwrap()));
        let name = |entry: &StageEntry| beside(entry).config["name"].as_str().unwrap().to_owned();
        let dated = name(&entry);
        assert!(dated.starts_with("20") && dated.ends_with("-1"), "{dated}");
        entry.config.insert("name".to_owned(), Value::from("walk"));
        assert_eq!(name(&entry), "walk-1");
        std::fs::create_dir(folder.path().join("walk-1")).unwrap();
        assert_eq!(name(&entry), "walk-2");
        let saver = StageEntry::of_kind("map_saver");
        assert_eq!(beside(&saver), saver);
    }
}
