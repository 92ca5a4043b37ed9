//! Looks for Livox devices as their driver does, and tells silence from a firewall.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4, UdpSocket};
use std::path::Path;
use std::time::{Duration, Instant};

use evac_formats::livox_sdk1::{Frames, Reply};
use evac_formats::livox_sdk2::{self, Frame, FrameKind, SearchReply, Sender};

use super::finding::Finding;
use super::lidar::TOPIC;
use super::wire::Wire;

/// Port on which devices of the first protocol announce themselves, each second.
const BROADCAST_PORT: u16 = 55_000;
const LISTENED: Duration = Duration::from_millis(2500);
/// Between two looks at all sockets.
const LOOK: Duration = Duration::from_millis(50);
/// Between two searches.
const AGAIN: Duration = Duration::from_millis(800);

/// Where to look, and for whom.
pub(super) struct Search<'a> {
    pub(super) root: &'a Path,
    pub(super) interface: Ipv4Addr,
    pub(super) device: Option<Ipv4Addr>,
    pub(super) second_protocol: bool,
}

impl Search<'_> {
    /// Listens for announcements, or asks who is there.
    pub(super) fn run(&self) -> Finding {
        let port = if self.second_protocol { livox_sdk2::ports::SEARCH } else { BROADCAST_PORT };
        let sockets = match listeners(self.interface, port) {
            Ok(sockets) => sockets,
            Err(cause) if cause.kind() == ErrorKind::AddrInUse => {
                return Finding::advice(
                    TOPIC,
                    format!("another program listens on UDP {port}"),
                    "end it if it is the vendor's viewer (`ss -lunp`): a device has one host",
                );
            }
            Err(cause) => return Finding::fault(TOPIC, format!("UDP {port}: {cause}"), "see `ss -lunp`"),
        };
        let (wire, before) = (Wire::open(), packets(self.root));
        let mut on_the_wire = None;
        let (until, mut ask_at) = (Instant::now() + LISTENED, Instant::now());
        while Instant::now() < until {
            if self.second_protocol && Instant::now() >= ask_at {
                ask_at += AGAIN;
                if let Err(cause) = self.ask(&sockets) {
                    let remedy =
                        format!("connect the LiDAR's network and give it {} (`ip -4 addr`)", self.interface);
                    return Finding::fault(
                        TOPIC,
                        format!("cannot search from {}: {cause}", self.interface),
                        remedy,
                    );
                }
            }
            std::thread::sleep(LOOK);
            if let Some((from, name)) = sockets.iter().find_map(|socket| self.heard(socket)) {
                return self.found(from, &name);
            }
            let is_wanted =
                |from: &Ipv4Addr| *from != self.interface && self.device.is_none_or(|it| it == *from);
            let seen = wire.as_ref().and_then(|wire| wire.senders_to(port).into_iter().find(is_wanted));
            on_the_wire = on_the_wire.or(seen);
        }
        match on_the_wire {
            Some(from) => self.eaten(from, port),
            None => self.silent(port, packets(self.root).saturating_sub(before), wire.is_some()),
        }
    }

    fn ask(&self, sockets: &[UdpSocket]) -> io::Result<()> {
        let mut bytes = Vec::new();
        Frame {
            sequence: 1,
            command: livox_sdk2::command::SEARCH,
            kind: FrameKind::Request,
            sender: Sender::Host,
            data: &[],
        }
        .encode(&mut bytes);
        let to = SocketAddrV4::new(self.device.unwrap_or(Ipv4Addr::BROADCAST), livox_sdk2::ports::SEARCH);
        sockets.first().map_or(Ok(0), |socket| socket.send_to(&bytes, to)).map(|_| ())
    }

    /// A device that has just been heard: its address and serial number.
    fn heard(&self, socket: &UdpSocket) -> Option<(Ipv4Addr, String)> {
        let mut buffer = [0; 2048];
        while let Ok((length, from)) = socket.recv_from(&mut buffer) {
            let (IpAddr::V4(from), bytes) = (from.ip(), buffer.get(..length).unwrap_or_default()) else {
                continue;
            };
            let name = if self.second_protocol { serial_of(bytes) } else { code_of(bytes) };
            if let Some(name) = name.filter(|_| self.device.is_none_or(|device| device == from)) {
                return Some((from, name));
            }
        }
        None
    }

    fn found(&self, from: Ipv4Addr, name: &str) -> Finding {
        let text = format!("Livox device {name} at {from}");
        let [ours, its] = [self.interface, from].map(|address| address.octets());
        if self.interface.is_loopback() || ours[..3] == its[..3] {
            return Finding::good(TOPIC, text);
        }
        let remedy = format!(
            "give this computer an address in {}.{}.{}.0/24 and set `interface`",
            its[0], its[1], its[2]
        );
        Finding::advice(TOPIC, format!("{text}, which is not in the network of {}", self.interface), remedy)
    }

    fn eaten(&self, from: Ipv4Addr, port: u16) -> Finding {
        let text = format!("packets of {from} to UDP {port} reach this machine, but not its programs");
        let remedy = format!(
            "a firewall eats them (`sudo nft list ruleset`; `sudo ufw allow in proto udp from {from}`), or the reverse path \
             filter, where {from} is in no network of this machine (`ip route get {from}`)"
        );
        Finding::fault(TOPIC, text, remedy)
    }

    fn silent(&self, port: u16, packets: u64, looked_at_the_wire: bool) -> Finding {
        let whom = self.device.map_or_else(|| "no device".to_owned(), |address| format!("not {address}"));
        let did = if self.second_protocol { "answered a search" } else { "announced itself" };
        let text = format!(
            "{whom} {did} on UDP {port} in {:.1} s; {packets} packets came in on all networks meanwhile",
            LISTENED.as_secs_f64(),
        );
        let mut remedy = format!("power, cable, and its network like {}'s", self.interface);
        if !self.second_protocol {
            remedy += "; a device that has a session announces nothing: end its host (`evac down`, the vendor's viewer)";
        }
        if !looked_at_the_wire {
            remedy += "; as root `evac doctor` also sees whether a firewall eats its packets";
        }
        Finding::fault(TOPIC, text, remedy)
    }
}

/// The broadcast code of an announcement.
fn code_of(bytes: &[u8]) -> Option<String> {
    Frames::new(bytes).find_map(|frame| match Reply::read(frame.set, frame.id, frame.payload) {
        Some(Reply::Broadcast(broadcast)) => Some(broadcast.code_text().to_owned()),
        _ => None,
    })
}

/// The serial number of an answer to a search.
fn serial_of(bytes: &[u8]) -> Option<String> {
    let frame = Frame::parse(bytes).ok()?;
    let is_answer = (frame.command, frame.kind) == (livox_sdk2::command::SEARCH, FrameKind::Ack);
    let reply = SearchReply::parse(frame.data).filter(|_| is_answer)?;
    let serial: Vec<u8> = reply.serial.into_iter().take_while(|byte| *byte != 0).collect();
    Some(String::from_utf8_lossy(&serial).into_owned())
}

/// Sockets that hear what is sent to the interface's address, and what is sent to all: one bound to an address does not hear the
/// latter.
fn listeners(interface: Ipv4Addr, port: u16) -> io::Result<Vec<UdpSocket>> {
    let addresses = [Some(interface), (!interface.is_loopback()).then_some(Ipv4Addr::BROADCAST)];
    let open = |address| {
        let socket = UdpSocket::bind(SocketAddrV4::new(address, port))?;
        socket.set_nonblocking(true)?;
        socket.set_broadcast(true)?;
        Ok(socket)
    };
    addresses.into_iter().flatten().map(open).collect()
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

    #[test]
    fn packets_of_all_networks_but_the_loopback_are_counted() {
        let text = "Inter-|   Receive\n face |bytes    packets errs\n    lo:  9 5 0 0\n  eth0: 100 7 0 0\n wlan0:3 4 0\n";
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(root.path().join("proc/net")).unwrap();
        std::fs::write(root.path().join("proc/net/dev"), text).unwrap();
        assert_eq!(packets(root.path()), 11);
    }
}
