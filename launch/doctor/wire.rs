//! What comes in on the wire, before firewall and routing have a say.

use std::net::Ipv4Addr;
use std::os::fd::OwnedFd;

use rustix::net::{AddressFamily, RecvFlags, SocketFlags, SocketType, eth, recv, socket_with};

/// A socket that sees every IPv4 packet of every network.
pub(super) struct Wire(OwnedFd);

impl Wire {
    /// `None` without the right to it (root, or CAP_NET_RAW).
    pub(super) fn open() -> Option<Self> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        socket_with(AddressFamily::PACKET, SocketType::DGRAM, flags, Some(eth::IP)).ok().map(Self)
    }

    /// Who has sent something to a UDP port since the last look.
    pub(super) fn senders_to(&self, port: u16) -> Vec<Ipv4Addr> {
        let (mut senders, mut buffer) = (Vec::new(), [0; 128]);
        while let Ok((length, _)) = recv(&self.0, &mut buffer[..], RecvFlags::empty()) {
            senders.extend(sender_to(buffer.get(..length).unwrap_or_default(), port));
        }
        senders
    }
}

/// The sender of an IPv4 packet that is UDP to a port.
fn sender_to(packet: &[u8], port: u16) -> Option<Ipv4Addr> {
    const UDP: u8 = 17;
    let header = packet.first_chunk::<20>()?;
    let length = usize::from(header[0] & 0xf) * 4;
    let [d0, d1] = *packet.get(length + 2..)?.first_chunk()?;
    let [a, b, c, d] = [header[12], header[13], header[14], header[15]];
    (header[0] >> 4 == 4 && header[9] == UDP && u16::from_be_bytes([d0, d1]) == port)
        .then(|| Ipv4Addr::new(a, b, c, d))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_udp_to_the_port_counts_and_cut_packets_are_nothing() {
        let mut packet = [0; 28];
        (packet[0], packet[9]) = (0x45, 17);
        packet[12..16].copy_from_slice(&[192, 168, 9, 12]);
        packet[22..24].copy_from_slice(&55_000_u16.to_be_bytes());
        assert_eq!(sender_to(&packet, 55_000), Some(Ipv4Addr::new(192, 168, 9, 12)));
        assert_eq!(sender_to(&packet, 55_001), None);
        for length in 0..24 {
            assert_eq!(sender_to(&packet[..length], 55_000), None, "{length}");
        }
        packet[9] = 6;
        assert_eq!(sender_to(&packet, 55_000), None);
    }
}
