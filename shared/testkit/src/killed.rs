//! Processes that are killed while they write.

use std::io;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Tells the process that is killed where to write.
const FOLDER: &str = "EVAC_TEST_KILLED_FOLDER";

/// The folder to write into, where this process was started by [`kill_while_writing`].
pub fn folder_of_killed() -> Option<std::path::PathBuf> {
    std::env::var_os(FOLDER).map(Into::into)
}

/// Starts this test executable's ignored test `writer`, which writes into `folder` without a pause, kills it some time after
/// `last_file` is there, and calls `check`; as often as `rounds` says.
///
/// # Errors
/// Where the process cannot be started, or has ended by itself.
pub fn kill_while_writing(
    writer: &str,
    folder: &Path,
    last_file: &str,
    rounds: u64,
    mut check: impl FnMut(),
) -> io::Result<()> {
    for round in 0..rounds {
        let mut child = Command::new(std::env::current_exe()?)
            .args(["--ignored", "--exact", writer])
            .env(FOLDER, folder)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        while !folder.join(last_file).exists() {
            if let Some(status) = child.try_wait()? {
                return Err(io::Error::other(format!("the process that writes has ended: {status}")));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        // Anywhere in the writing, without a clock: 0 to 480 ms in steps that follow no rhythm.
        std::thread::sleep(Duration::from_millis(round * 7919 % 481));
        child.kill()?;
        child.wait()?;
        check();
    }
    Ok(())
}
