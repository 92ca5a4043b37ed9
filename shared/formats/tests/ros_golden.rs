//! ROS 1 and ROS 2 messages and bags against bytes of an independent library.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use evac_formats::ros::{
    CloudField, CustomMsg, CustomPoint, Datatype, Encoding, Imu, PointCloud2, Stamp, TimeUnit, write_cloud,
    write_custom_msg, write_imu,
};
use evac_formats::rosbag::BagIndex;
use serde_json::Value;

const STAMP: i64 = 1_795_269_615_123_456_789;

const ENCODINGS: [(Encoding, &str); 2] = [(Encoding::Ros1, "ros1_hex"), (Encoding::Cdr, "cdr_le_hex")];

fn golden() -> Option<Value> {
    let path = evac_testkit::data("protocols/ros/messages.json")?;
    Some(serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap())
}

fn hex(text: &Value) -> Vec<u8> {
    let text = text.as_str().unwrap();
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
}

fn floats(value: &Value, names: [&str; 3]) -> [f32; 3] {
    names.map(|name| value[name].as_f64().unwrap() as f32)
}

#[track_caller]
fn check_custom(encoding: Encoding, bytes: &[u8], decoded: &Value) {
    let message = CustomMsg::parse(bytes, encoding).unwrap();
    assert_eq!(
        (message.header.seq, message.header.stamp_ns, message.header.frame_id),
        (if encoding == Encoding::Ros1 { 7 } else { 0 }, STAMP, b"livox_frame".as_slice())
    );
    assert_eq!((message.timebase_ns, message.lidar_id, message.len()), (STAMP, 1, 3));
    for (index, expected) in decoded["points"].as_array().unwrap().iter().enumerate() {
        let point = message.point(index).unwrap();
        assert_eq!(point.position, floats(expected, ["x", "y", "z"]));
        let values =
            [u64::from(point.offset_ns), point.reflectivity.into(), point.tag.into(), point.line.into()];
        let names = ["offset_time", "reflectivity", "tag", "line"];
        assert_eq!(values, names.map(|name| expected[name].as_u64().unwrap()));
    }
    assert_eq!(message.point(3), None);
}

#[track_caller]
fn check_cloud(encoding: Encoding, bytes: &[u8], decoded: &Value, timed: bool) {
    let cloud = PointCloud2::parse(bytes, encoding).unwrap();
    assert_eq!((cloud.header.stamp_ns, cloud.len(), cloud.has_time()), (STAMP, 3, timed));
    let mut times = Vec::new();
    for (index, expected) in decoded["points"].as_array().unwrap().iter().enumerate() {
        let point = cloud.point(index).unwrap();
        assert_eq!(point.position, floats(expected, ["x", "y", "z"]));
        assert_eq!(u64::from(point.intensity), expected["reflectivity"].as_u64().unwrap());
        times.extend(point.time);
        if let Some(time) = point.time {
            // A double of nanoseconds since 1970 has steps of 256 ns.
            let exact = STAMP as f64 + expected["offset_time"].as_f64().unwrap();
            assert!((time - exact).abs() <= 256.0, "{time} is not {exact}");
        }
    }
    if timed {
        assert_eq!(TimeUnit::of_frame(times[2] - times[0]), Some(TimeUnit::Nanoseconds));
    }
    assert_eq!(cloud.point(3), None);
}

#[track_caller]
fn check_imu(encoding: Encoding, bytes: &[u8], decoded: &Value) {
    let imu = Imu::parse(bytes, encoding).unwrap();
    assert_eq!((imu.header.stamp_ns, imu.header.frame_id), (STAMP, b"livox_frame".as_slice()));
    for (values, name) in [(imu.gyro, "gyro"), (imu.accel, "acc_g")] {
        let expected = [0, 1, 2].map(|axis| decoded["imu"][name][axis].as_f64().unwrap());
        assert_eq!(values, expected);
    }
}

#[test]
fn messages_of_both_livox_drivers_are_decoded() {
    let Some(golden) = golden() else { return };
    for driver in ["livox_ros_driver", "livox_ros_driver2"] {
        let messages = &golden[driver];
        assert!(CustomMsg::TYPES.contains(&messages["custom"]["type_ros1"].as_str().unwrap()));
        for (encoding, key) in ENCODINGS {
            check_custom(encoding, &hex(&messages["custom"][key]), &golden["decoded"]);
            check_cloud(encoding, &hex(&messages["pc2_driver1"][key]), &golden["decoded"], false);
            check_cloud(encoding, &hex(&messages["pc2_driver2"][key]), &golden["decoded"], true);
            check_imu(encoding, &hex(&messages["imu"][key]), &golden["decoded"]);
        }
    }
}

#[test]
fn messages_are_written_as_both_livox_drivers_write_them() {
    let Some(golden) = golden() else { return };
    let header = Stamp { seq: 7, stamp_ns: STAMP, frame_id: "livox_frame" };
    let points: Vec<_> = golden["decoded"]["points"].as_array().unwrap().iter().map(point_of).collect();
    let mut fields = vec![
        CloudField { name: "x", offset: 0, datatype: Datatype::F32 },
        CloudField { name: "y", offset: 4, datatype: Datatype::F32 },
        CloudField { name: "z", offset: 8, datatype: Datatype::F32 },
        CloudField { name: "intensity", offset: 12, datatype: Datatype::F32 },
        CloudField { name: "tag", offset: 16, datatype: Datatype::U8 },
        CloudField { name: "line", offset: 17, datatype: Datatype::U8 },
    ];
    for timed in [false, true] {
        if timed {
            fields.push(CloudField { name: "timestamp", offset: 18, datatype: Datatype::F64 });
        }
        for (encoding, key) in ENCODINGS {
            let mut out = Vec::new();
            write_cloud(&mut out, encoding, &header, &fields, if timed { 26 } else { 18 }, 3, |out| {
                for point in &points {
                    out.extend(point.position.iter().flat_map(|axis| axis.to_le_bytes()));
                    out.extend(f32::from(point.reflectivity).to_le_bytes());
                    out.extend([point.tag, point.line]);
                    let stamp = (STAMP + i64::from(point.offset_ns)) as f64;
                    out.extend(stamp.to_le_bytes().iter().filter(|_| timed));
                }
            });
            let name = if timed { "pc2_driver2" } else { "pc2_driver1" };
            assert_eq!(out, hex(&golden["livox_ros_driver2"][name][key]), "{name} {key}");
        }
    }
    for (encoding, key) in ENCODINGS {
        let mut out = Vec::new();
        write_custom_msg(&mut out, encoding, &header, STAMP, 1, &points);
        assert_eq!(out, hex(&golden["livox_ros_driver2"]["custom"][key]), "{key}");
        out.clear();
        write_imu(&mut out, encoding, &header, [0.01, -0.02, 0.03], [0.01, -0.02, 1.0], [0.0; 9]);
        assert_eq!(out, hex(&golden["livox_ros_driver2"]["imu"][key]), "{key}");
    }
}

fn point_of(value: &Value) -> CustomPoint {
    let byte = |name: &str| value[name].as_u64().unwrap() as u8;
    CustomPoint {
        offset_ns: value["offset_time"].as_u64().unwrap() as u32,
        position: floats(value, ["x", "y", "z"]),
        reflectivity: byte("reflectivity"),
        tag: byte("tag"),
        line: byte("line"),
    }
}

#[test]
fn a_big_endian_ros_2_message_is_read_and_other_encapsulations_are_refused() {
    let mut bytes = vec![0, 0, 0, 0];
    bytes.extend(1_i32.to_be_bytes());
    bytes.extend(2_u32.to_be_bytes());
    bytes.extend(2_u32.to_be_bytes());
    bytes.extend(*b"a\0\0\0\0\0\0\0\0\0\0\0"); // up to the multiple of eight
    bytes.truncate(4 + 16);
    bytes.extend([0_u8; (4 + 9) * 8]);
    for value in [0.5_f64, 1.0, 2.0] {
        bytes.extend(value.to_be_bytes());
    }
    bytes.extend([0_u8; (9 + 3 + 9) * 8]);
    let imu = Imu::parse(&bytes, Encoding::Cdr).unwrap();
    assert_eq!(
        (imu.header.stamp_ns, imu.header.frame_id, imu.gyro),
        (1_000_000_002, &b"a"[..], [0.5, 1.0, 2.0])
    );
    bytes[1] = 7;
    assert!(Imu::parse(&bytes, Encoding::Cdr).unwrap_err().to_string().contains("00 07"));
}

#[test]
fn messages_that_end_too_early_are_refused() {
    let Some(golden) = golden() else { return };
    let names = ["custom", "pc2_driver1", "pc2_driver2", "imu"];
    for (name, (encoding, key)) in names.iter().flat_map(|name| ENCODINGS.map(|encoding| (*name, encoding))) {
        let bytes = hex(&golden["livox_ros_driver"][name][key]);
        // A PointCloud2 ends with its flag is_dense, which nobody needs.
        for length in 0..bytes.len() - 1 {
            let cut = &bytes[..length];
            let refused = match name {
                "custom" => CustomMsg::parse(cut, encoding).is_err(),
                "imu" => Imu::parse(cut, encoding).is_err(),
                _ => PointCloud2::parse(cut, encoding).is_err(),
            };
            assert!(refused, "{name} of {length} bytes");
        }
    }
}

#[test]
fn the_tiny_bag_holds_the_golden_messages() {
    let (Some(path), Some(golden)) = (evac_testkit::data("protocols/ros/tiny_ros1.bag"), golden()) else {
        return;
    };
    let index = BagIndex::read(&path, false).unwrap();
    let mut seen = 0;
    for connection in index.connections() {
        let mut reader = index.messages(&[connection.id]).unwrap();
        let mut count = 0;
        while let Some(message) = reader.next_message().unwrap() {
            assert_eq!(message.connection, connection.id);
            match connection.type_name.as_str() {
                Imu::TYPE => check_imu(Encoding::Ros1, message.data, &golden["decoded"]),
                PointCloud2::TYPE => {
                    let timed = PointCloud2::parse(message.data, Encoding::Ros1).unwrap().has_time();
                    check_cloud(Encoding::Ros1, message.data, &golden["decoded"], timed);
                }
                name if CustomMsg::TYPES.contains(&name) => {
                    check_custom(Encoding::Ros1, message.data, &golden["decoded"]);
                }
                other => panic!("{other} on {}", connection.topic),
            }
            count += 1;
        }
        assert_eq!(count, connection.messages, "{}", connection.topic);
        seen += count;
    }
    assert!(seen >= 3, "{seen} messages");
}

#[test]
fn bags_with_bz2_and_lz4_chunks_have_all_their_messages_in_the_order_of_recording() {
    for (file, seconds) in [("hall_first_6s_bz2.bag", 6), ("hall_first_2s_lz4.bag", 2)] {
        let Some(path) = evac_testkit::data(&format!("simulated/bags/{file}")) else { return };
        let index = BagIndex::read(&path, false).unwrap();
        let counts: Vec<_> = index.connections().iter().map(|c| (c.topic.as_str(), c.messages)).collect();
        for (topic, rate) in [("/livox/lidar", 10), ("/livox/points", 10), ("/livox/imu", 200)] {
            assert!(counts.contains(&(topic, rate * seconds)), "{counts:?}");
        }
        let wanted: Vec<_> = index.connections().iter().map(|connection| connection.id).collect();
        let mut reader = index.messages(&wanted).unwrap();
        let (mut last, mut count) = (i64::MIN, 0);
        while let Some(message) = reader.next_message().unwrap() {
            assert!(message.time_ns >= last);
            last = message.time_ns;
            count += 1;
        }
        assert_eq!(count, 220 * seconds);
    }
}
