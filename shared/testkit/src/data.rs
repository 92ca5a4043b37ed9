//! The folder of golden vectors and recordings, which a user's clone does not have.

use std::path::{Path, PathBuf};

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
