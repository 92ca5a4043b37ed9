//! The way from a Livox device to its driver: address, ports, buffers, firewall.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::path::Path;

use evac_config::StageEntry;

use super::finding::Finding;
use super::search::Search;

pub(super) const TOPIC: &str = "lidar";
/// What the driver asks for where its configuration names nothing, MiB.
const BUFFER_MIB: u64 = 4;
const SYSCTL: &str = "install launch/sysctl/60-evac.conf, which says how";

/// Whether the system gives the receive buffer that a driver asks for.
pub(crate) fn buffers(root: &Path, wanted_mib: Option<u64>) -> Finding {
    let wanted_mib = wanted_mib.unwrap_or(BUFFER_MIB);
    let text = std::fs::read_to_string(root.join("proc/sys/net/core/rmem_max")).unwrap_or_default();
    let Ok(most) = text.trim().parse::<u64>() else {
        return Finding::advice(TOPIC, "net.core.rmem_max cannot be read", SYSCTL);
    };
    let found = format!("net.core.rmem_max = {most}, a driver asks for {wanted_mib} MiB");
    if most >= wanted_mib * 1_048_576 {
        return Finding::good(TOPIC, found);
    }
    // A Mid-40 sends 1.4 MB/s, each packet of which takes almost twice its size in the buffer.
    let text = format!(
        "{found}: what a Mid-40 sends in more than {:.0} ms of stall gets lost",
        most as f64 / 2600.0
    );
    Finding::advice(TOPIC, text, SYSCTL)
}

/// What a stage of kind `lidar` needs.
pub(crate) fn look(root: &Path, entry: &StageEntry) -> Vec<Finding> {
    let text = |key: &str| entry.config.get(key).and_then(toml::Value::as_str);
    let wanted = entry.config.get("receive_buffer_mib").and_then(toml::Value::as_integer);
    let mut findings = vec![buffers(root, wanted.and_then(|mib| u64::try_from(mib).ok()))];
    let interface = text("interface").and_then(|address| address.parse().ok()).unwrap_or(Ipv4Addr::LOCALHOST);
    match address(interface) {
        Ok(found) => findings.push(found),
        Err(fault) => {
            findings.push(fault);
            return findings;
        }
    }
    let device = text("device").and_then(|address| address.parse().ok());
    let second_protocol = text("protocol") == Some("sdk2");
    findings.push(Search { root, interface, device, second_protocol }.run());
    findings
}

/// Whether this machine has the address.
fn address(interface: Ipv4Addr) -> Result<Finding, Finding> {
    match UdpSocket::bind(SocketAddrV4::new(interface, 0)) {
        Ok(_) => Ok(Finding::good(TOPIC, format!("this machine has the address {interface}"))),
        Err(cause) if cause.kind() == ErrorKind::AddrNotAvailable => Err(Finding::fault(
            TOPIC,
            format!("this machine has no address {interface}"),
            "`sudo ip addr add ADDRESS/24 dev INTERFACE` in the LiDAR's network, or correct `interface` (`ip -4 addr`)",
        )),
        Err(cause) => {
            Err(Finding::fault(TOPIC, format!("{interface}: {cause}"), "correct `interface` (`ip -4 addr`)"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Grade;

    fn root_with(path: &str, text: &str) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join(path);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
        root
    }

    #[test]
    fn a_buffer_that_the_system_does_not_give_is_advised_on() {
        let root = root_with("proc/sys/net/core/rmem_max", "212992\n");
        let finding = buffers(root.path(), None);
        assert_eq!(finding.grade, Grade::Advice);
        assert!(finding.text.contains("82 ms"), "{}", finding.text);
        let root = root_with("proc/sys/net/core/rmem_max", "8388608\n");
        assert_eq!(buffers(root.path(), Some(8)).grade, Grade::Good);
        assert_eq!(buffers(root.path(), Some(9)).grade, Grade::Advice);
    }

    #[test]
    fn an_address_of_another_machine_is_a_fault() {
        assert!(address(Ipv4Addr::LOCALHOST).is_ok());
        // TEST-NET-1 of RFC 5737: nobody has it.
        assert_eq!(address(Ipv4Addr::new(192, 0, 2, 77)).unwrap_err().grade, Grade::Fault);
    }
}
