//! Whether the processor sleeps between two scans.

use std::collections::BTreeMap;
use std::path::Path;

use super::finding::Finding;

const TOPIC: &str = "processor";

/// The governors of all cores.
pub(crate) fn look(root: &Path) -> Finding {
    let mut governors: BTreeMap<String, usize> = BTreeMap::new();
    for entry in std::fs::read_dir(root.join("sys/devices/system/cpu")).into_iter().flatten().flatten() {
        if let Ok(governor) = std::fs::read_to_string(entry.path().join("cpufreq/scaling_governor")) {
            *governors.entry(governor.trim().to_owned()).or_default() += 1;
        }
    }
    let text: Vec<_> =
        governors.iter().map(|(governor, cores)| format!("{governor} on {cores} cores")).collect();
    match text.as_slice() {
        [] => Finding::good(TOPIC, "no frequency scaling"),
        [one] if governors.contains_key("performance") => Finding::good(TOPIC, one.as_str()),
        _ => {
            let remedy = "for even latencies: `sudo cpupower frequency-set -g performance` (a Jetson: `sudo jetson_clocks`)";
            Finding::advice(TOPIC, format!("governor {}", text.join(", ")), remedy)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Grade;

    #[test]
    fn cores_that_save_power_are_counted() {
        let root = tempfile::tempdir().unwrap();
        assert_eq!(look(root.path()).grade, Grade::Good);
        for (core, governor) in ["performance", "powersave"].iter().enumerate() {
            let folder = root.path().join(format!("sys/devices/system/cpu/cpu{core}/cpufreq"));
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("scaling_governor"), format!("{governor}\n")).unwrap();
        }
        let finding = look(root.path());
        assert_eq!(finding.grade, Grade::Advice);
        assert!(finding.text.contains("powersave on 1 cores"), "{}", finding.text);
    }
}
