//! What is written as MCAP is read by the format's own library, and by the reader here.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeMap;

use evac_formats::mcap::{BARE_END, McapIndex, McapWriter, Packing};

/// Messages as they are written: topic, sequence, time, bytes.
fn messages() -> Vec<(u16, u32, u64, Vec<u8>)> {
    let message = |n: u32| (n as u16 % 3, n, u64::from(n) * 1000 + 7, vec![n as u8; n as usize % 50]);
    (0..200).map(message).collect()
}

/// A file of chunks of 30 messages, and its length after each of them.
fn write(packing: Packing) -> (Vec<u8>, Vec<u64>) {
    let mut writer = McapWriter::new(Vec::new(), "ros2", "a test", packing).unwrap();
    writer.attach("rig.toml", "application/toml", b"[rig]\n").unwrap();
    let schema = writer.add_schema("std_msgs/msg/UInt8MultiArray", "ros2msg", b"uint8[] data\n").unwrap();
    let metadata = BTreeMap::from([("layout".to_owned(), "evac.Point.v1".to_owned())]);
    for topic in ["/a", "/b", "/c", "/never"] {
        writer.add_channel(schema, topic, "cdr", &metadata).unwrap();
    }
    let mut ends = Vec::new();
    for (n, (channel, sequence, time, bytes)) in messages().iter().enumerate() {
        writer.write(*channel, *sequence, *time, bytes);
        if n % 30 == 29 {
            ends.push(writer.end_chunk().unwrap());
        }
    }
    (writer.finish().unwrap(), ends)
}

/// What the reader here finds in `bytes`.
fn read(bytes: &[u8], allow_truncated: bool) -> Vec<(u16, u64, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, bytes).unwrap();
    let index = McapIndex::read(&path, allow_truncated).unwrap();
    assert_eq!(index.connections()[1].metadata["layout"], "evac.Point.v1");
    let mut reader = index.messages(&[0, 1, 2]).unwrap();
    let mut found = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        found.push((message.connection as u16, message.time_ns as u64, message.data.to_vec()));
    }
    found
}

fn written() -> Vec<(u16, u64, Vec<u8>)> {
    messages().into_iter().map(|(channel, _, time, bytes)| (channel, time, bytes)).collect()
}

#[test]
fn the_format_s_own_library_finds_every_message_the_attachment_and_the_summary() {
    let (bytes, _) = write(Packing::None);
    let found: Vec<_> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| {
            let message = message.unwrap();
            assert_eq!(message.channel.schema.as_ref().unwrap().encoding, "ros2msg");
            assert_eq!(message.log_time, message.publish_time);
            (message.channel.id, message.sequence, message.log_time, message.data.to_vec())
        })
        .collect();
    assert_eq!(found, messages());
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let statistics = summary.stats.as_ref().unwrap();
    assert_eq!((statistics.message_count, statistics.channel_count, statistics.chunk_count), (200, 4, 7));
    assert_eq!((statistics.message_start_time, statistics.message_end_time), (7, 199_007));
    assert_eq!(statistics.channel_message_counts, BTreeMap::from([(0, 67), (1, 67), (2, 66)]));
    // Chunk by chunk, by their places and by the indexes behind them.
    let by_chunk: usize = summary
        .chunk_indexes
        .iter()
        .map(|chunk| {
            let indexes = summary.read_message_indexes(&bytes, chunk).unwrap();
            let counted: usize = indexes.values().map(Vec::len).sum();
            assert_eq!(summary.stream_chunk(&bytes, chunk).unwrap().count(), counted);
            counted
        })
        .sum();
    assert_eq!(by_chunk, 200);
    let attachment = mcap::read::attachment(&bytes, &summary.attachment_indexes[0]).unwrap();
    assert_eq!((attachment.name.as_str(), attachment.data.as_ref()), ("rig.toml", b"[rig]\n".as_slice()));
}

#[test]
fn packed_or_not_the_messages_are_the_same_and_packed_the_file_is_smaller() {
    let [plain, packed] = [Packing::None, Packing::Lz4].map(|packing| write(packing).0);
    assert_eq!(read(&plain, false), written());
    assert_eq!(read(&packed, false), written());
    assert!(packed.len() < plain.len(), "{} {}", packed.len(), plain.len());
}

#[test]
fn a_file_that_is_closed_behind_any_of_its_chunks_without_a_summary_is_whole() {
    for packing in [Packing::None, Packing::Lz4] {
        let (bytes, ends) = write(packing);
        for (chunks, end) in ends.iter().enumerate() {
            let closed = [&bytes[..*end as usize], &BARE_END].concat();
            assert_eq!(read(&closed, false), written()[..(chunks + 1) * 30]);
            if packing == Packing::None {
                let counted = mcap::MessageStream::new(&closed).unwrap().map(Result::unwrap).count();
                assert_eq!(counted, (chunks + 1) * 30);
            }
        }
    }
}

#[test]
fn a_file_that_is_cut_anywhere_gives_all_chunks_before_the_cut() {
    for packing in [Packing::None, Packing::Lz4] {
        let (bytes, ends) = write(packing);
        let first = ends[0] as usize;
        for cut in (first..bytes.len()).step_by(13) {
            let whole = ends.iter().filter(|end| **end as usize <= cut).count() * 30;
            let found = read(&bytes[..cut], true);
            assert!(found.len() >= whole && found == written()[..found.len()], "cut at {cut}");
        }
    }
}
