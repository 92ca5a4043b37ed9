//! Files appear whole or not at all.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::FormatError;

/// Writes a file through a temporary one beside it, which replaces it in one step when `write` has succeeded.
/// A reader never sees half a file, and a failure leaves the old one.
///
/// # Errors
/// [`FormatError::Io`] naming `path`.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
) -> Result<(), FormatError> {
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

#[cfg(test)]
mod tests {
    use super::*;

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
