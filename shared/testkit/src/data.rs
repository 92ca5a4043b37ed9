//! The folder of golden vectors and recordings, which a user's clone does not have.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// Path of a file or folder of the test data: `$EVAC_DATA`, or `../shared/data` beside the checkout.
/// Where it is absent it prints why the calling test is skipped and returns `None`.
pub fn data(relative: &str) -> Option<PathBuf> {
    let root = match std::env::var_os("EVAC_DATA") {
        Some(folder) => PathBuf::from(folder),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
    };
    let path = root.join(relative);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {relative} is not in the test data (set EVAC_DATA to the folder that has it)");
    None
}

/// A file of the test data that is kept as `relative` with `.xz` after its name, unpacked once into the build's folder.
/// Where it or the command `xz` is absent it prints why the calling test is skipped and returns `None`.
pub fn unpacked(relative: &str) -> Option<PathBuf> {
    let packed = data(&format!("{relative}.xz"))?;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/unpacked").join(relative);
    if path.exists() {
        return Some(path);
    }
    match unpack(&packed, &path) {
        Ok(()) => Some(path),
        Err(cause) => {
            println!("skipped: {relative}.xz cannot be unpacked: {cause}");
            None
        }
    }
}

/// Through a file of its own, since several tests may do this at the same time.
fn unpack(packed: &Path, path: &Path) -> std::io::Result<()> {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    let part = path.with_extension(format!("{}-{number}.part", std::process::id()));
    fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
    let status = Command::new("xz").arg("-dc").arg(packed).stdout(File::create(&part)?).status()?;
    if !status.success() {
        return Err(std::io::Error::other(format!("xz ended with {status}")));
    }
    fs::rename(part, path)
}
