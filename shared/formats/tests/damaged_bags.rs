//! Bags that were cut off are told; no bytes whatsoever make the parsers of bags and ROS messages panic, hang or take
//! memory without bounds.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use std::fs;
use std::sync::LazyLock;

use evac_formats::ros::{CustomMsg, Encoding, Imu, PointCloud2, octets};
use evac_formats::rosbag::BagIndex;
use proptest::prelude::*;

use common::damaged;

fn read_message(bytes: &[u8]) {
    read_message_as(bytes, Encoding::Ros1);
    read_message_as(bytes, Encoding::Cdr);
}

fn read_message_as(bytes: &[u8], encoding: Encoding) {
    let _ = octets(bytes, encoding);
    let _ = Imu::parse(bytes, encoding);
    if let Ok(message) = CustomMsg::parse(bytes, encoding) {
        assert!((0..message.len()).all(|index| message.point(index).is_some()));
    }
    if let Ok(cloud) = PointCloud2::parse(bytes, encoding) {
        assert!(cloud.len() <= bytes.len());
        assert!((0..cloud.len()).all(|index| cloud.point(index).is_some()));
    }
}

fn read_bag(bytes: &[u8], tolerant: bool) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bag");
    fs::write(&path, bytes).unwrap();
    let Ok(index) = BagIndex::read(&path, tolerant) else { return };
    let wanted: Vec<_> = index.connections().iter().map(|connection| connection.id).collect();
    let mut reader = index.messages(&wanted).unwrap();
    while let Ok(Some(message)) = reader.next_message() {
        read_message(message.data);
    }
}

/// A record of a bag.
fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        header.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        header.extend(name.as_bytes());
        header.push(b'=');
        header.extend(*value);
    }
    let mut bytes = (header.len() as u32).to_le_bytes().to_vec();
    bytes.extend(header);
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes
}

/// A `PointCloud2` of two points with x, y, z and a time.
fn a_cloud() -> Vec<u8> {
    let mut bytes = vec![0; 12]; // header without a frame name
    bytes.extend(0_u32.to_le_bytes());
    for value in [1, 2, 4_u32] {
        bytes.extend(value.to_le_bytes()); // height, width, fields
    }
    for (name, offset, datatype) in [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("timestamp", 12, 8_u8)] {
        bytes.extend((name.len() as u32).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend(u32::to_le_bytes(offset));
        bytes.push(datatype);
        bytes.extend(1_u32.to_le_bytes());
    }
    bytes.push(0);
    for value in [20, 40, 40_u32] {
        bytes.extend(value.to_le_bytes()); // steps and length of the data
    }
    bytes.extend([0x3f; 40]);
    bytes.push(1);
    bytes
}

fn a_custom_msg() -> Vec<u8> {
    let mut bytes = vec![0; 12 + 4 + 8]; // header without a frame name, time base
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend([1, 0, 0, 0]);
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend([0x3e; 38]);
    bytes
}

/// A closed bag with one chunk of a point cloud and a Livox message.
fn a_bag(compression: &str) -> Vec<u8> {
    let id = |id: u32| id.to_le_bytes();
    let connection = |number: u32, topic: &[u8], kind: &[u8]| {
        let inner = record(&[("topic", topic), ("type", kind)], &[]);
        let length = u32::from_le_bytes([inner[0], inner[1], inner[2], inner[3]]) as usize;
        record(&[("op", &[7]), ("conn", &id(number)), ("topic", topic)], &inner[4..4 + length])
    };
    let connections = [
        connection(0, b"/points", b"sensor_msgs/PointCloud2"),
        connection(1, b"/livox/lidar", b"livox_ros_driver/CustomMsg"),
    ]
    .concat();
    let mut chunk = connections.clone();
    chunk.extend(record(&[("op", &[2]), ("conn", &id(0)), ("time", &[0; 8])], &a_cloud()));
    chunk.extend(record(&[("op", &[2]), ("conn", &id(1)), ("time", &[0; 8])], &a_custom_msg()));
    let size = id(chunk.len() as u32);
    let packed = match compression {
        "bz2" => {
            let mut packed = Vec::new();
            let mut encoder = bzip2::read::BzEncoder::new(chunk.as_slice(), bzip2::Compression::fast());
            std::io::Read::read_to_end(&mut encoder, &mut packed).unwrap();
            packed
        }
        "lz4" => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            std::io::Write::write_all(&mut encoder, &chunk).unwrap();
            encoder.finish().unwrap()
        }
        _ => chunk,
    };
    let chunk = record(&[("op", &[5]), ("compression", compression.as_bytes()), ("size", &size)], &packed);
    let counted = |number: u32| {
        record(&[("op", &[4]), ("ver", &id(1)), ("conn", &id(number)), ("count", &id(1))], &[0; 12])
    };
    let head = |index_pos: u64| {
        let fields: [(&str, &[u8]); 4] = [
            ("op", &[3]),
            ("index_pos", &index_pos.to_le_bytes()),
            ("conn_count", &id(2)),
            ("chunk_count", &id(1)),
        ];
        [b"#ROSBAG V2.0\n".as_slice(), &record(&fields, &[b' '; 32])].concat()
    };
    let body = [chunk, counted(0), counted(1)].concat();
    let index_pos = (head(0).len() + body.len()) as u64;
    [head(index_pos), body, connections].concat()
}

#[test]
fn the_undamaged_bytes_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    for compression in ["none", "bz2", "lz4"] {
        let path = folder.path().join(compression);
        fs::write(&path, a_bag(compression)).unwrap();
        let index = BagIndex::read(&path, false).unwrap();
        let messages: Vec<_> = index.connections().iter().map(|connection| connection.messages).collect();
        assert_eq!(messages, [1, 1], "{compression}");
        let mut reader = index.messages(&[0, 1]).unwrap();
        let cloud = reader.next_message().unwrap().unwrap();
        assert_eq!(PointCloud2::parse(cloud.data, Encoding::Ros1).unwrap().len(), 2);
        let custom = reader.next_message().unwrap().unwrap();
        assert_eq!(CustomMsg::parse(custom.data, Encoding::Ros1).unwrap().len(), 2);
        assert!(reader.next_message().unwrap().is_none());
    }
}

#[test]
fn a_bag_that_was_never_closed_is_refused_and_read_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.bag.active");
    let closed = a_bag("lz4");
    let (at, index_pos) = index_pos(&closed);
    // As it lies on the disk while it is recorded: neither position nor connections at the end, nor the last counts.
    let mut open = closed[..index_pos].to_vec();
    open[at..at + 8].fill(0);
    fs::write(&path, open).unwrap();
    let refused = BagIndex::read(&path, false).unwrap_err().to_string();
    assert!(
        refused.contains("byte 13") && refused.contains("never closed") && refused.contains("reindex"),
        "{refused}"
    );
    let index = BagIndex::read(&path, true).unwrap();
    let topics: Vec<_> = index.connections().iter().map(|c| (c.topic.as_str(), c.messages)).collect();
    assert_eq!(topics, [("/points", 1), ("/livox/lidar", 1)]);
}

#[test]
fn a_closed_bag_that_was_cut_between_two_records_is_refused_and_read_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.bag");
    let closed = a_bag("bz2");
    let (_, index_pos) = index_pos(&closed);
    let index_record = record(
        &[("op", &[4]), ("ver", &[1, 0, 0, 0]), ("conn", &[0; 4]), ("count", &[1, 0, 0, 0])],
        &[0; 12],
    );
    // Without the connections at the end; without the last chunk's second, and without both of its counts.
    for cut in [index_pos, index_pos - index_record.len(), index_pos - 2 * index_record.len()] {
        fs::write(&path, &closed[..cut]).unwrap();
        let refused = BagIndex::read(&path, false).unwrap_err().to_string();
        assert!(refused.contains("cut off") && refused.contains(&format!("byte {cut}")), "{refused}");
        let index = BagIndex::read(&path, true).unwrap();
        let messages: Vec<_> = index.connections().iter().map(|c| (c.topic.as_str(), c.messages)).collect();
        assert_eq!(messages, [("/points", 1), ("/livox/lidar", 1)], "{cut} of {index_pos} bytes");
        assert_eq!(index.truncated_at(), Some(cut as u64));
    }
}

/// Where a bag's header says where its index begins, and what it says.
fn index_pos(bag: &[u8]) -> (usize, usize) {
    let mark = b"index_pos=";
    let at = bag.windows(mark.len()).position(|window| window == mark).unwrap() + mark.len();
    (at, u64::from_le_bytes(bag[at..at + 8].try_into().unwrap()) as usize)
}

static BAGS: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| ["none", "bz2", "lz4"].map(a_bag));

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn ros_messages(cloud in damaged(a_cloud()), custom in damaged(a_custom_msg())) {
        read_message(&cloud);
        read_message(&custom);
    }

    #[test]
    fn bags(bytes in (0..3_usize).prop_flat_map(|which| damaged(BAGS[which].clone())), tolerant in any::<bool>()) {
        read_bag(&bytes, tolerant);
    }
}
