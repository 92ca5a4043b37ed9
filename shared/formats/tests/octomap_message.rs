//! Maps as `octomap_msgs/Octomap`: bodies of OctoMap's own files, and messages that another library reads.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use evac_formats::octomap::{BinaryValues, Node, OcTreeFile, OctomapBody, read};
use evac_formats::ros::{Encoding, Octomap, Stamp, schemas, write_octomap};
use evac_testkit::{data, ros_libraries};

const NAME: &str = "message";

fn tree() -> OcTreeFile {
    let inner = |child_mask| Node { log_odds: 1.5, child_mask };
    let mut nodes = vec![inner(0b1000_0000); 15];
    nodes.push(inner(0b11));
    nodes.extend([Node { log_odds: 1.5, child_mask: 0 }, Node { log_odds: -0.4, child_mask: 0 }]);
    OcTreeFile::new(0.123_456_789, nodes).unwrap()
}

#[test]
fn bodies_are_what_octomap_writes_behind_the_text_of_its_files_and_read_back_as_they_do() {
    let Some(folder) = data("octomap-golden") else { return };
    for set in ["empty", "prune_break", "scan3_r10", "scan3_r20"] {
        let file = |extension: &str| folder.join(format!("{set}.{extension}"));
        let tree = read(&file("ot")).unwrap();
        let values = BinaryValues::default();
        for (body, extension) in [
            (OctomapBody::full(&tree), "ot"),
            (OctomapBody::binary(&tree, &values), "bt"),
            (OctomapBody::binary_as_it_stands(&tree, values.threshold), "const.bt"),
        ] {
            let path = file(extension);
            let theirs = OctomapBody::of_file(&fs::read(&path).unwrap(), &path).unwrap();
            assert!(body == theirs, "{set}.{extension}");
            assert_eq!(
                theirs.tree(Path::new(NAME), &values).unwrap(),
                read(&path).unwrap(),
                "{set}.{extension}"
            );
        }
    }
}

#[test]
fn a_resolution_keeps_all_its_digits_unlike_in_files() {
    let body = OctomapBody::full(&tree());
    assert_eq!(body.tree(Path::new(NAME), &BinaryValues::default()).unwrap(), tree());
}

#[test]
fn damaged_bodies_are_errors_that_name_the_byte() {
    for whole in [OctomapBody::full(&tree()), OctomapBody::binary_as_it_stands(&tree(), 0.0)] {
        for length in 1..whole.data.len() {
            let cut = OctomapBody { data: whole.data[..length].to_vec(), ..whole.clone() };
            let error = cut.tree(Path::new(NAME), &BinaryValues::default()).unwrap_err();
            assert!(error.to_string().contains("message"), "{error}");
        }
        let flat = OctomapBody { resolution: f64::NAN, ..whole };
        assert!(flat.tree(Path::new(NAME), &BinaryValues::default()).is_err());
    }
}

#[test]
fn messages_of_both_encodings_read_back_and_rosbags_reads_them_too() {
    let folder = tempfile::tempdir().unwrap();
    let header = Stamp { seq: 0, stamp_ns: 1_700_000_000_000_000_001, frame_id: "map" };
    for body in [OctomapBody::full(&tree()), OctomapBody::binary_as_it_stands(&tree(), 0.0)] {
        for encoding in [Encoding::Ros1, Encoding::Cdr] {
            let mut bytes = Vec::new();
            write_octomap(&mut bytes, encoding, &header, &body);
            let read = Octomap::parse(&bytes, encoding).unwrap();
            assert_eq!((read.header.stamp_ns, read.header.frame_id), (header.stamp_ns, &b"map"[..]));
            assert_eq!(read.body(), Some(body.clone()));
            assert!((0..bytes.len()).all(|length| Octomap::parse(&bytes[..length], encoding).is_err()));
        }
        let mut cdr = Vec::new();
        write_octomap(&mut cdr, Encoding::Cdr, &header, &body);
        let [message, definition] = ["message.cdr", "Octomap.msg"].map(|name| folder.path().join(name));
        fs::write(&message, cdr).unwrap();
        fs::write(&definition, schemas::OCTOMAP.text).unwrap();
        let Some(said) = ros_libraries(&[Path::new("octomap"), &message, &definition]) else { return };
        let bytes: Vec<String> = body.data.iter().map(|byte| format!("{byte:02x}")).collect();
        let expected = format!("map 1700000000.1 {} OcTree 0.123456789 {}", body.binary, bytes.concat());
        assert_eq!(said.unwrap().trim(), expected);
    }
}
