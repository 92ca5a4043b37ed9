//! Shared memory: what dead pipelines left, and whether there is room.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use evac_ports::Domain;

use super::finding::Finding;

const TOPIC: &str = "shared memory";
const SHARED: &str = "/dev/shm";
/// A pipeline takes some 200 MiB when all its buffers have been full once.
const ROOM_MIB: u64 = 256;
/// With less not even the first scans fit. (A container gets 64 unless it is told otherwise.)
const LEAST_MIB: u64 = 65;
/// Digits of the hash that the middleware puts behind a domain's prefix.
const HASH: usize = 40;

/// Domains whose files no living process has; of one domain only, or of all.
pub(crate) fn leftovers(clean: bool, only: Option<&str>) -> Vec<Finding> {
    let uid = rustix::process::getuid().as_raw();
    let mut domains: BTreeMap<String, (usize, u64)> = BTreeMap::new();
    for entry in fs::read_dir(SHARED).into_iter().flatten().flatten() {
        let file = entry.file_name();
        let file = file.to_string_lossy();
        if let Some(name) = domain_of(&file, uid).filter(|name| only.is_none_or(|only| only == *name)) {
            let (files, bytes) = domains.entry(name.to_owned()).or_default();
            *files += 1;
            *bytes += entry.metadata().map_or(0, |data| data.len());
        }
    }
    let mut findings = Vec::new();
    let (mut alive, mut cleaned) = (0, 0);
    for (name, (files, bytes)) in &domains {
        let Ok(domain) = Domain::new(name) else { continue };
        if domain.holder().is_some() || is_mapped(&domain.prefix()) {
            alive += 1;
            continue;
        }
        // Taking a domain and giving it back removes everything in it.
        if clean && domain.lock().map(drop).is_ok() {
            cleaned += 1;
            continue;
        }
        let text = format!(
            "a dead pipeline in domain '{name}' left {files} files, {:.1} MiB",
            *bytes as f64 / 1_048_576.0
        );
        findings.push(Finding::advice(TOPIC, text, "`evac doctor --clean`"));
    }
    if findings.is_empty() {
        let text = match cleaned {
            0 => format!("no leftovers of dead pipelines; {alive} domains in use"),
            _ => format!("leftovers of {cleaned} dead domains removed; {alive} domains in use"),
        };
        findings.push(Finding::good(TOPIC, text));
    }
    findings
}

/// The domain that a file in shared memory belongs to: `evac-UID-DOMAIN_HASH_...`.
fn domain_of(file: &str, uid: u32) -> Option<&str> {
    let rest = file.strip_prefix(&format!("evac-{uid}-"))?;
    let is_hash = |text: &str| {
        text.get(..HASH).is_some_and(|hash| hash.bytes().all(|byte| byte.is_ascii_hexdigit()))
            && text.get(HASH..).is_some_and(|after| after.starts_with('_'))
    };
    let mut borders = rest.match_indices('_').map(|(at, _)| at);
    let border = borders.find(|at| rest.get(at + 1..).is_some_and(is_hash))?;
    rest.get(..border)
}

/// Whether a living process has a file of that prefix in its memory.
fn is_mapped(prefix: &str) -> bool {
    let wanted = format!("{SHARED}/{prefix}");
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    processes
        .filter(|entry| entry.file_name().to_string_lossy().bytes().all(|byte| byte.is_ascii_digit()))
        .any(|entry| fs::read_to_string(entry.path().join("maps")).is_ok_and(|maps| maps.contains(&wanted)))
}

/// Whether a pipeline's buffers fit.
pub(crate) fn room() -> Finding {
    match rustix::fs::statvfs(Path::new(SHARED)) {
        Ok(found) => judge_room(found.f_bavail * found.f_frsize / 1_048_576),
        Err(cause) => Finding::fault(
            TOPIC,
            format!("{SHARED}: {cause}"),
            "mount a tmpfs there: the stages share memory",
        ),
    }
}

fn judge_room(free_mib: u64) -> Finding {
    let text = format!("{free_mib} MiB free in {SHARED}");
    let remedy = "`sudo mount -o remount,size=1G /dev/shm`; in a container --shm-size=1g or --ipc=host";
    match free_mib {
        0..LEAST_MIB => Finding::fault(TOPIC, text, remedy),
        LEAST_MIB..ROOM_MIB => Finding::advice(TOPIC, text, remedy),
        _ => Finding::good(TOPIC, text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Grade;

    #[test]
    fn a_file_s_domain_is_read_from_its_name() {
        let hash = "0354a209029e7d094a819e2d4030ea331e6caaf0";
        assert_eq!(domain_of(&format!("evac-7-a_b-c_{hash}_109.data"), 7), Some("a_b-c"));
        assert_eq!(domain_of(&format!("evac-7-a_{hash}_node.0_10_0.global_mgmt"), 7), Some("a"));
        assert_eq!(domain_of(&format!("evac-8-a_{hash}_109.data"), 7), None);
        for name in ["evac-7-", "evac-7-a_", "evac-7-a_0354_1.data", "iox2_x.data", "evac-7-\u{e9}_\u{e9}"] {
            assert_eq!(domain_of(name, 7), None, "{name}");
        }
    }

    #[test]
    fn a_container_s_64_mib_stop_a_run() {
        assert_eq!(judge_room(64).grade, Grade::Fault);
        assert_eq!(judge_room(128).grade, Grade::Advice);
        assert_eq!(judge_room(4000).grade, Grade::Good);
    }
}
