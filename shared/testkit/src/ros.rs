//! Other people's libraries of ROS bags and MCAP, in a Python environment that `tests/ros/setup` makes.

use std::path::Path;
use std::process::Command;

/// Runs `tests/ros/bags.py` with arguments and gives what it prints. Where the environment is absent it prints why the
/// calling test is skipped and returns `None`.
///
/// # Errors
/// What the script says when it fails.
pub fn ros_libraries(arguments: &[&Path]) -> Option<Result<String, String>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let python = root.join("target/ros-venv/bin/python");
    if !python.exists() {
        println!("skipped: the libraries mcap and rosbags are not installed (run tests/ros/setup)");
        return None;
    }
    let output = Command::new(python).arg(root.join("tests/ros/bags.py")).args(arguments).output();
    Some(match output {
        Ok(output) if output.status.success() => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        Ok(output) => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
        Err(cause) => Err(cause.to_string()),
    })
}
