//! Captures in every byte order, resolution and link type that `tcpdump` writes.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;

use evac_formats::FormatError;
use evac_formats::pcap::{PcapCounts, PcapReader, PcapWriter};

const SOURCE: &str = "192.168.1.11:65000";
const HOST: &str = "192.168.1.50:56001";
const TIME: i64 = 1_700_000_000_123_456_000;

/// What a reader tells of a datagram.
type Seen = (i64, String, String, Vec<u8>);

fn read(bytes: &[u8]) -> Result<(Vec<Seen>, PcapCounts), FormatError> {
    let mut reader = PcapReader::new(bytes, Path::new("a.pcap"))?;
    let mut seen = Vec::new();
    while let Some(udp) = reader.next_datagram()? {
        seen.push((udp.time_ns, udp.source.to_string(), udp.destination.to_string(), udp.payload.to_vec()));
    }
    Ok((seen, reader.counts()))
}

fn written(payloads: &[&[u8]]) -> Vec<u8> {
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    for payload in payloads {
        writer.write_udp(TIME, SOURCE.parse().unwrap(), HOST.parse().unwrap(), payload).unwrap();
    }
    writer.finish().unwrap()
}

fn expected(payload: &[u8]) -> Seen {
    (TIME, SOURCE.to_owned(), HOST.to_owned(), payload.to_vec())
}

/// The IPv4 packet of one written datagram.
fn ip_packet(payload: &[u8]) -> Vec<u8> {
    written(&[payload])[24 + 16 + 14..].to_vec()
}

/// A capture with one packet; `big` and `nano` choose its byte order and resolution.
fn capture(link: u32, packet: &[u8], big: bool, nano: bool) -> Vec<u8> {
    let word = |value: u32| if big { value.to_be_bytes() } else { value.to_le_bytes() };
    let mut bytes = word(if nano { 0xa1b2_3c4d } else { 0xa1b2_c3d4 }).to_vec();
    bytes.extend(if big { [0, 2, 0, 4] } else { [2, 0, 4, 0] });
    let fraction = if nano { 123_456_000 } else { 123_456 };
    let length = packet.len() as u32;
    for value in [0, 0, 65_535, link, 1_700_000_000, fraction, length, length] {
        bytes.extend(word(value));
    }
    bytes.extend(packet);
    bytes
}

#[test]
fn what_is_written_is_read_back() {
    let (seen, counts) = read(&written(&[b"one", b"", &[7; 1318]])).unwrap();
    assert_eq!(seen, [expected(b"one"), expected(b""), expected(&[7; 1318])]);
    assert_eq!((counts.packets, counts.datagrams), (3, 3));
}

#[test]
fn a_datagram_that_a_capture_cannot_hold_is_not_written() {
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    for (time, length) in [(-1, 1), (i64::MAX, 1), (TIME, 65_508)] {
        let (source, host) = (SOURCE.parse().unwrap(), HOST.parse().unwrap());
        assert!(writer.write_udp(time, source, host, &vec![0; length]).is_err(), "{time} ns, {length} bytes");
    }
    assert_eq!(writer.finish().unwrap().len(), 24);
}

#[test]
fn the_written_ip_header_has_the_right_checksum() {
    let packet = ip_packet(b"evac");
    let sum: u32 = packet[..20].chunks(2).map(|word| u32::from(u16::from_be_bytes([word[0], word[1]]))).sum();
    assert_eq!((sum & 0xffff) + (sum >> 16), 0xffff);
}

#[test]
fn both_byte_orders_and_resolutions_give_the_same_time() {
    let mut packet = vec![0; 12];
    packet.extend([0x08, 0x00]);
    packet.extend(ip_packet(b"x"));
    packet.extend([0; 17]); // padding of a short Ethernet frame
    for (big, nano) in [(false, false), (false, true), (true, false), (true, true)] {
        assert_eq!(read(&capture(1, &packet, big, nano)).unwrap().0, [expected(b"x")]);
    }
}

#[test]
fn every_link_type_is_looked_through() {
    let ip = ip_packet(b"x");
    let with = |head: &[u8]| [head, &ip].concat();
    let vlan = [[0; 12].as_slice(), &[0x88, 0xa8, 0, 5, 0x81, 0, 0, 9, 8, 0]].concat();
    let cooked = [[0; 14].as_slice(), &[8, 0]].concat();
    let cooked2 = [[8, 0].as_slice(), &[0; 18]].concat();
    for (link, packet) in [
        (1, with(&vlan)),
        (101, ip.clone()),
        (228, ip.clone()),
        (113, with(&cooked)),
        (276, with(&cooked2)),
        (0, with(&[2, 0, 0, 0])),
        (0, with(&[0, 0, 0, 2])),
    ] {
        assert_eq!(
            read(&capture(link, &packet, false, false)).unwrap().0,
            [expected(b"x")],
            "link type {link}"
        );
    }
    let refused = read(&capture(105, &ip, false, false)).unwrap_err().to_string();
    assert!(refused.contains("a.pcap: byte 20: link type 105"), "{refused}");
}

#[test]
fn what_is_no_whole_udp_datagram_is_counted_and_passed_over() {
    let counts = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut packet = ip_packet(b"four");
        change(&mut packet);
        let (seen, counts) = read(&capture(101, &packet, false, false)).unwrap();
        assert_eq!(seen, []);
        (counts.other, counts.fragments, counts.cut)
    };
    assert_eq!(counts(&|packet| packet[9] = 6), (1, 0, 0));
    assert_eq!(counts(&|packet| packet[0] = 0x65), (1, 0, 0));
    assert_eq!(counts(&|packet| packet[6] = 0x20), (0, 1, 0));
    assert_eq!(counts(&|packet| packet[7] = 3), (0, 1, 0));
    assert_eq!(counts(&|packet| packet.truncate(30)), (0, 0, 1));
    assert_eq!(counts(&|packet| packet[25] = 7), (0, 0, 1));
    assert_eq!(counts(&|packet| packet[0] = 0x44), (0, 0, 1));
}

#[test]
fn a_cut_off_capture_names_the_packet_it_ends_in_or_ends_before_it_on_request() {
    let bytes = written(&[b"one", b"two"]);
    let second = 24 + (bytes.len() - 24) / 2;
    for length in second + 1..bytes.len() {
        let cut = &bytes[..length];
        let refused = read(cut).unwrap_err().to_string();
        assert!(
            refused.contains(&format!("a.pcap: byte {second}: the file ends inside a packet")),
            "{refused}"
        );
        let mut reader = PcapReader::new(cut, Path::new("a.pcap")).unwrap().tolerate_truncation(true);
        assert!(reader.next_datagram().unwrap().is_some());
        assert!(reader.next_datagram().unwrap().is_none());
        assert_eq!(reader.counts().truncated_at, Some(second as u64));
    }
    for length in 1..24 {
        assert!(read(&bytes[..length]).is_err());
    }
}

#[test]
fn other_files_are_called_by_their_names() {
    for (start, name) in [
        (b"\x0a\x0d\x0d\x0a".as_slice(), "pcapng"),
        (b"\xfd7zXZ\0", "xz"),
        (b"\x1f\x8b\x08\0", "gzip"),
        (b"#ROSBAG V2.0\n", "ROS bag"),
        (b"\x55\x51\0\0", "WT901C"),
        (b"PK\x03\x04", "no pcap file"),
        (b"", "empty"),
    ] {
        let refused = read(start).unwrap_err().to_string();
        assert!(refused.starts_with("a.pcap: byte 0: ") && refused.contains(name), "{refused}");
    }
}
