//! Files appear whole or not at all.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use crate::FormatError;

/// What a temporary file's writer, whoever it is, has not touched for so long it does not write any more.
const ABANDONED: Duration = Duration::from_secs(10);

/// Writes a file through a temporary one beside it, which replaces it in one step when `write` has succeeded.
/// A reader never sees half a file, and a failure leaves the old one. What a process that was killed left half written of the same
/// file is removed.
///
/// # Errors
/// [`FormatError::Io`] naming `path`.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
) -> Result<(), FormatError> {
    remove_abandoned(path);
    write_through_another(path, |writer| {
        write(writer)?;
        writer.flush()?;
        writer.get_ref().sync_all()
    })
}

/// As [`write_atomically`], without waiting for the disk: for files that need not outlive a power cut.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_for_this_boot(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
) -> Result<(), FormatError> {
    write_through_another(path, |writer| {
        write(writer)?;
        writer.flush()
    })
}

fn write_through_another(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
) -> Result<(), FormatError> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(name);
    let result = File::create(&temporary)
        .and_then(|file| write(&mut BufWriter::new(file)))
        .and_then(|()| fs::rename(&temporary, path));
    if result.is_err() {
        // The failure is reported below; a temporary file that cannot be removed either adds nothing to it.
        let _ = fs::remove_file(&temporary);
    }
    result.map_err(|cause| FormatError::writing(path, cause))
}

/// Removes temporary files of `path` whose writers are dead. Nothing depends on it, so failures are left alone.
fn remove_abandoned(path: &Path) {
    let (Some(name), Some(folder)) = (path.file_name().and_then(|name| name.to_str()), path.parent()) else {
        return;
    };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let other = entry.file_name();
        let writer = (other.to_str())
            .and_then(|other| other.strip_prefix(name)?.strip_prefix('.')?.strip_suffix(".tmp"))
            .and_then(|pid| pid.parse::<u32>().ok());
        let is_dead = writer.is_some_and(|pid| !Path::new("/proc").join(pid.to_string()).exists());
        // Another machine's or container's process is not in this /proc.
        let is_old = || entry.metadata()?.modified()?.elapsed().map_err(std::io::Error::other);
        if is_dead && is_old().is_ok_and(|age| age > ABANDONED) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_killed_process_left_half_written_goes_and_what_others_write_stays() {
        let folder = tempfile::tempdir().unwrap();
        let leave = |name: &str, age_s: u64| {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(std::time::SystemTime::now() - Duration::from_secs(age_s)).unwrap();
        };
        // No process has a number that large.
        leave("map.bt.4194305.tmp", 60);
        leave("map.bt.4194306.tmp", 0);
        leave(&format!("map.bt.{}.tmp", std::os::unix::process::parent_id()), 60);
        leave("map.bt.notes.tmp", 60);
        leave("map.ot.4194305.tmp", 60);
        write_atomically(&folder.path().join("map.bt"), |w| w.write_all(b"new")).unwrap();
        let mut left: Vec<String> = (fs::read_dir(folder.path()).unwrap())
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        left.sort();
        let parent = format!("map.bt.{}.tmp", std::os::unix::process::parent_id());
        let mut expected =
            ["map.bt", "map.bt.4194306.tmp", &parent, "map.bt.notes.tmp", "map.ot.4194305.tmp"];
        expected.sort_unstable();
        assert_eq!(left, expected);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_temporary_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.bt");
        write_atomically(&path, |w| w.write_all(b"old")).unwrap();
        let failure = write_atomically(&path, |w| {
            w.write_all(b"new")?;
            Err(std::io::Error::other("power cut"))
        });
        assert!(failure.unwrap_err().to_string().contains("power cut"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
