//! The way from a Livox device to its driver: address, ports, buffers, firewall.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::path::Path;
use std::time::{Duration, Instant};

use evac_config::StageEntry;

use super::finding::Finding;

const TOPIC: &str = "lidar";
/// What the driver asks for where its configuration names nothing, MiB.
const BUFFER_MIB: u64 = 4;
/// Port on which devices of the first protocol announce themselves, each second.
const BROADCAST_PORT: u16 = 55_000;
const LISTENED: Duration = Duration::from_millis(2500);
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
    if text("protocol") != Some("sdk2") && !interface.is_loopback() {
        let device = text("device").and_then(|address| address.parse().ok());
        findings.push(announcements(root, interface, device));
    }
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

/// Listens for devices of the first protocol, and tells silence from a firewall.
fn announcements(root: &Path, interface: Ipv4Addr, device: Option<Ipv4Addr>) -> Finding {
    let socket = match UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, BROADCAST_PORT)) {
        Ok(socket) => socket,
        Err(cause) if cause.kind() == ErrorKind::AddrInUse => {
            let text = format!("another program listens on UDP {BROADCAST_PORT}");
            return Finding::advice(
                TOPIC,
                text,
                "end it if it is the vendor's viewer (`ss -lunp`): a device has one host",
            );
        }
        Err(cause) => {
            return Finding::fault(TOPIC, format!("UDP {BROADCAST_PORT}: {cause}"), "see `ss -lunp`");
        }
    };
    let before = packets(root);
    match listen(&socket, device) {
        Some(from) => Finding::good(TOPIC, format!("a Livox device announces itself from {from}")),
        None => {
            let whom = device.map_or_else(|| "no device".to_owned(), |address| format!("not {address}"));
            let text = format!(
                "{whom} announced itself on UDP {BROADCAST_PORT} in {:.1} s; {} packets came in on all networks meanwhile",
                LISTENED.as_secs_f64(),
                packets(root).saturating_sub(before)
            );
            let remedy = format!(
                "power, cable, and its network like {interface}'s; if `sudo tcpdump -ni any udp port {BROADCAST_PORT}` \
                 shows packets, a firewall eats them (`sudo nft list ruleset`, `sudo ufw status`)"
            );
            Finding::fault(TOPIC, text, remedy)
        }
    }
}

/// The first sender, or the wanted one.
fn listen(socket: &UdpSocket, device: Option<Ipv4Addr>) -> Option<std::net::IpAddr> {
    let until = Instant::now() + LISTENED;
    let mut buffer = [0; 2048];
    while let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
        socket.set_read_timeout(Some(left)).ok()?;
        if let Ok((_, from)) = socket.recv_from(&mut buffer)
            && device.is_none_or(|device| from.ip() == device)
        {
            return Some(from.ip());
        }
    }
    None
}

/// Packets that have come in on all networks but the loopback.
fn packets(root: &Path) -> u64 {
    let text = std::fs::read_to_string(root.join("proc/net/dev")).unwrap_or_default();
    let received = |line: &str| {
        let (name, numbers) = line.split_once(':')?;
        let count = numbers.split_whitespace().nth(1)?.parse::<u64>().ok()?;
        (name.trim() != "lo").then_some(count)
    };
    text.lines().filter_map(received).sum()
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
    fn packets_of_all_networks_but_the_loopback_are_counted() {
        let text = "Inter-|   Receive\n face |bytes    packets errs\n    lo:  9 5 0 0\n  eth0: 100 7 0 0\n wlan0:3 4 0\n";
        assert_eq!(packets(root_with("proc/net/dev", text).path()), 11);
    }

    #[test]
    fn an_address_of_another_machine_is_a_fault() {
        assert!(address(Ipv4Addr::LOCALHOST).is_ok());
        // TEST-NET-1 of RFC 5737: nobody has it.
        assert_eq!(address(Ipv4Addr::new(192, 0, 2, 77)).unwrap_err().grade, Grade::Fault);
    }
}
