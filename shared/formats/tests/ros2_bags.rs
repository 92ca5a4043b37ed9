//! ROS 2 bags: MCAP files of the maker's own library, a db3 bag of an independent one, and folders of both.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use evac_formats::bag::{Bag, Messages};
use evac_formats::ros::{CustomMsg, Encoding, Imu, PointCloud2, octets};
use mcap::records::MessageHeader;
use proptest::prelude::*;

use common::damaged;

/// Two topics with `count` messages each, of 8 bytes and their own number. Chunks are small.
fn mcap_file(count: u32, chunks: bool) -> Vec<u8> {
    let options = mcap::WriteOptions::new().profile("ros2").chunk_size(Some(200)).use_chunks(chunks);
    let mut writer = options.create(std::io::Cursor::new(Vec::new())).unwrap();
    let metadata = BTreeMap::from([("layout".to_owned(), "evac.Point.v1".to_owned())]);
    let mut channels = Vec::new();
    for (topic, kind) in [("/a", "sensor_msgs/msg/Imu"), ("/b", "std_msgs/msg/String")] {
        let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
        channels.push(writer.add_channel(schema, topic, "cdr", &metadata).unwrap());
    }
    for sequence in 0..count {
        for channel_id in channels.iter().copied() {
            let log_time = u64::from(sequence) * 1000;
            let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, &[sequence as u8; 8]).unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    path
}

/// First bytes of all messages of a topic.
fn first_bytes(bag: &Bag, topic: &str) -> Vec<u8> {
    let id = bag.connections().iter().find(|connection| connection.topic == topic).unwrap().id;
    let (mut messages, mut bytes) = (Messages::new(bag, &[id]), Vec::new());
    while let Some(message) = messages.next_message().unwrap() {
        assert_eq!((message.connection, message.data.len()), (id, 8));
        bytes.push(message.data[0]);
    }
    bytes
}

#[test]
fn an_mcap_file_has_its_topics_and_messages_with_chunks_and_without() {
    let folder = tempfile::tempdir().unwrap();
    for chunks in [true, false] {
        let bag = Bag::open(&write(folder.path(), "a.mcap", &mcap_file(40, chunks)), false).unwrap();
        let known: Vec<_> =
            bag.connections().iter().map(|c| (c.topic.as_str(), c.type_name.as_str(), c.messages)).collect();
        assert_eq!(known, [("/a", "sensor_msgs/msg/Imu", 40), ("/b", "std_msgs/msg/String", 40)]);
        assert_eq!(bag.connections()[0].metadata["layout"], "evac.Point.v1");
        assert_eq!(first_bytes(&bag, "/b"), (0..40).collect::<Vec<u8>>(), "chunks: {chunks}");
    }
}

#[test]
fn chunks_packed_with_lz4_and_zstd_are_read_and_a_wrong_checksum_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let plain = mcap_file(40, true);
    let lz4 = |data: &[u8]| {
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        std::io::Write::write_all(&mut encoder, data).unwrap();
        encoder.finish().unwrap()
    };
    let zstd =
        |data: &[u8]| ruzstd::encoding::compress_to_vec(data, ruzstd::encoding::CompressionLevel::Fastest);
    for (name, file) in [("lz4", repacked(&plain, "lz4", lz4)), ("zstd", repacked(&plain, "zstd", zstd))] {
        let bag = Bag::open(&write(folder.path(), "a.mcap", &file), false).unwrap();
        assert_eq!(first_bytes(&bag, "/a"), (0..40).collect::<Vec<u8>>(), "{name}");
    }
    let other = Bag::open(&write(folder.path(), "a.mcap", &repacked(&plain, "xz", <[u8]>::to_vec)), false);
    let said = other.unwrap_err().to_string();
    assert!(said.contains("unknown chunk compression \"xz\"") && said.contains("mcap compress"), "{said}");
    let mut wrong = plain;
    let message = wrong.windows(8).position(|bytes| bytes == [3; 8]).unwrap();
    wrong[message] ^= 1;
    let bag = Bag::open(&write(folder.path(), "a.mcap", &wrong), false).unwrap();
    let said = read_all(&bag).unwrap();
    assert!(said.contains("checksum") && said.contains("byte "), "{said}");
}

fn read_all(bag: &Bag) -> Option<String> {
    let ids: Vec<_> = bag.connections().iter().map(|connection| connection.id).collect();
    let mut messages = Messages::new(bag, &ids);
    loop {
        match messages.next_message() {
            Ok(None) => return None,
            Ok(Some(_)) => {}
            Err(error) => return Some(error.to_string()),
        }
    }
}

/// The file with every chunk's data packed.
fn repacked(file: &[u8], name: &str, pack: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let (magic, mut rest) = file.split_at(8);
    let mut out = magic.to_vec();
    while rest.len() > 8 {
        let length = u64::from_le_bytes(rest[1..9].try_into().unwrap()) as usize;
        let (record, after) = rest.split_at(9 + length);
        if record[0] == 6 {
            // start, end, size, crc, compression (empty), length of the data
            let (head, data) = record[9..].split_at(8 + 8 + 8 + 4);
            let packed = pack(&data[4 + 8..]);
            let mut body = head.to_vec();
            body.extend((name.len() as u32).to_le_bytes());
            body.extend(name.as_bytes());
            body.extend((packed.len() as u64).to_le_bytes());
            body.extend(packed);
            out.push(6);
            out.extend((body.len() as u64).to_le_bytes());
            out.extend(body);
        } else {
            out.extend(record);
        }
        rest = after;
    }
    out.extend(rest);
    out
}

#[test]
fn a_file_that_was_cut_is_refused_and_read_up_to_its_last_whole_chunk_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let whole = mcap_file(40, true);
    for cut in [10, 200, 700, 1500] {
        let path = write(folder.path(), "a.mcap", &whole[..whole.len() - cut]);
        let said = Bag::open(&path, false).unwrap_err().to_string();
        assert!(said.contains("a.mcap: byte ") && said.contains("--allow-truncated"), "{said}");
        let bag = Bag::open(&path, true).unwrap();
        assert!(bag.truncated().count() == 1);
        let bytes = first_bytes(&bag, "/a");
        assert!(bytes.len() >= 10 && bytes.iter().enumerate().all(|(at, byte)| at == usize::from(*byte)));
    }
}

#[test]
fn files_of_a_folder_follow_each_other_by_their_numbers_or_as_the_metadata_say() {
    let folder = tempfile::tempdir().unwrap();
    for (name, count) in [("walk_2.mcap", 2), ("walk_10.mcap", 3), ("walk_9.mcap", 1)] {
        write(folder.path(), name, &mcap_file(count, true));
    }
    let bag = Bag::open(folder.path(), false).unwrap();
    assert_eq!(bag.connections()[0].messages, 6);
    assert_eq!(first_bytes(&bag, "/a"), [0, 1, 0, 0, 1, 2]);
    let metadata = "rosbag2_bagfile_information:\n  relative_file_paths:\n    - walk_10.mcap\n    - old/walk_9.mcap\n  \
                    compression_mode: \"\"\n";
    write(folder.path(), "metadata.yaml", metadata.as_bytes());
    assert_eq!(first_bytes(&Bag::open(folder.path(), false).unwrap(), "/a"), [0, 1, 2, 0]);
    write(folder.path(), "metadata.yaml", b"  compression_mode: FILE\n");
    let said = Bag::open(folder.path(), false).unwrap_err().to_string();
    assert!(said.contains("metadata.yaml") && said.contains("ros2 bag convert"), "{said}");
    let empty = tempfile::tempdir().unwrap();
    assert!(Bag::open(empty.path(), false).unwrap_err().to_string().contains("no recording"));
}

#[test]
fn the_tiny_ros_2_bag_holds_the_golden_messages() {
    let (Some(path), Some(golden)) =
        (evac_testkit::data("protocols/ros/tiny_ros2"), evac_testkit::data("protocols/ros/messages.json"))
    else {
        return;
    };
    let golden: serde_json::Value = serde_json::from_slice(&fs::read(golden).unwrap()).unwrap();
    for path in [path.clone(), path.join("tiny_ros2.db3")] {
        let bag = Bag::open(&path, false).unwrap();
        assert_eq!(bag.connections().len(), 3);
        for connection in bag.connections() {
            let mut messages = Messages::new(&bag, &[connection.id]);
            let data = messages.next_message().unwrap().unwrap().data.to_vec();
            let name = match connection.topic.as_str() {
                "/livox/imu" => "imu",
                "/livox/lidar" => "custom",
                _ => "pc2_driver2",
            };
            let hex: String = data.iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(hex, golden["livox_ros_driver2"][name]["cdr_le_hex"], "{name}");
            assert!(messages.next_message().unwrap().is_none());
        }
    }
}

fn read_bag(bytes: &[u8], tolerant: bool) {
    let folder = tempfile::tempdir().unwrap();
    let Ok(bag) = Bag::open(&write(folder.path(), "a", bytes), tolerant) else { return };
    let ids: Vec<_> = bag.connections().iter().map(|connection| connection.id).collect();
    let mut messages = Messages::new(&bag, &ids);
    while let Ok(Some(message)) = messages.next_message() {
        let _ = octets(message.data, Encoding::Cdr);
        let _ = Imu::parse(message.data, Encoding::Cdr);
        let _ = CustomMsg::parse(message.data, Encoding::Cdr);
        let _ = PointCloud2::parse(message.data, Encoding::Cdr);
    }
}

static MCAP: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| [true, false].map(|chunks| mcap_file(5, chunks)));
static DB3: LazyLock<Option<Vec<u8>>> =
    LazyLock::new(|| fs::read(evac_testkit::data("protocols/ros/tiny_ros2/tiny_ros2.db3")?).ok());

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_mcap_files(
        chunked in damaged(MCAP[0].clone()), loose in damaged(MCAP[1].clone()), tolerant: bool
    ) {
        read_bag(&chunked, tolerant);
        read_bag(&loose, tolerant);
    }

    #[test]
    fn damaged_databases(
        bytes in damaged(DB3.clone().unwrap_or_else(|| b"SQLite format 3\0".to_vec())), tolerant: bool
    ) {
        read_bag(&bytes, tolerant);
    }
}
