//! Serial adapters: which there are, whether this user may use them, whether they keep bytes back.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};

use super::finding::Finding;

const TOPIC: &str = "serial port";
/// An FTDI adapter that keeps bytes longer than this spoils the stamps' jitter, milliseconds.
const LATENCY_MS: u32 = 2;

/// All USB adapters.
pub(crate) fn look(root: &Path) -> Vec<Finding> {
    let folder = root.join("dev");
    let names = std::fs::read_dir(&folder).into_iter().flatten().flatten();
    let mut ports: Vec<PathBuf> = names
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            ["ttyUSB", "ttyACM", "ttyTHS"].iter().any(|kind| name.starts_with(kind))
        })
        .collect();
    ports.sort();
    if ports.is_empty() {
        return vec![Finding::good(TOPIC, "no adapters (ttyUSB*, ttyACM*, ttyTHS*)")];
    }
    ports.iter().flat_map(|port| [permission(port), latency(root, port)]).flatten().collect()
}

/// Whether this user may read and write it.
pub(crate) fn permission(port: &Path) -> Option<Finding> {
    let name = port.display();
    if access(port, Access::READ_OK | Access::WRITE_OK).is_ok() {
        return Some(Finding::good(TOPIC, format!("{name} may be used")));
    }
    let data = std::fs::metadata(port).ok()?;
    let group = group_name(&std::fs::read_to_string("/etc/group").unwrap_or_default(), data.gid());
    let text = format!("{name} may not be used by this user (group {group}, mode {:o})", data.mode() & 0o777);
    let remedy = format!("`sudo usermod -aG {group} $USER`, then log in again");
    Some(Finding::fault(TOPIC, text, remedy))
}

fn latency(root: &Path, port: &Path) -> Option<Finding> {
    let name = port.file_name()?;
    let path = root.join("sys/bus/usb-serial/devices").join(name).join("latency_timer");
    let timer: u32 = std::fs::read_to_string(path).ok()?.trim().parse().ok()?;
    let text = format!("{} keeps bytes for up to {timer} ms (latency_timer)", port.display());
    if timer <= LATENCY_MS {
        return Some(Finding::good(TOPIC, text));
    }
    let remedy = "install launch/udev/99-evac-imu.rules, which says how";
    Some(Finding::advice(TOPIC, text, remedy))
}

/// A group's name by its number, from the text of /etc/group.
fn group_name(groups: &str, gid: u32) -> String {
    let by_number = |line: &&str| line.split(':').nth(2).is_some_and(|number| number == gid.to_string());
    let line = groups.lines().find(by_number);
    line.and_then(|line| line.split(':').next()).map_or_else(|| gid.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Grade;

    #[test]
    fn adapters_are_found_and_one_that_keeps_bytes_back_is_named() {
        let root = tempfile::tempdir().unwrap();
        let timer = root.path().join("sys/bus/usb-serial/devices/ttyUSB0");
        std::fs::create_dir_all(&timer).unwrap();
        std::fs::create_dir_all(root.path().join("dev")).unwrap();
        std::fs::write(timer.join("latency_timer"), "16\n").unwrap();
        assert!(look(root.path())[0].text.contains("no adapters"));
        for name in ["ttyUSB0", "ttyS0", "ttyACM1"] {
            std::fs::write(root.path().join("dev").join(name), "").unwrap();
        }
        let findings = look(root.path());
        assert_eq!(findings.len(), 3, "{findings:?}");
        assert!(findings[2].text.contains("16 ms") && findings[2].grade == Grade::Advice);
    }

    #[test]
    fn a_group_is_called_by_its_name() {
        let groups = "root:x:0:\ndialout:x:20:anna,ben\nbroken\n";
        assert_eq!(group_name(groups, 20), "dialout");
        assert_eq!(group_name(groups, 21), "21");
    }
}
