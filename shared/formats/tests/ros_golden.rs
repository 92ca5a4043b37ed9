//! ROS 1 messages and bags against bytes of an independent library.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use evac_formats::ros1::{CustomMsg, Imu, PointCloud2, TimeUnit};
use evac_formats::rosbag::{BagIndex, BagReader};
use serde_json::Value;

const STAMP: i64 = 1_795_269_615_123_456_789;

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
fn check_custom(bytes: &[u8], decoded: &Value) {
    let message = CustomMsg::parse(bytes).unwrap();
    assert_eq!(
        (message.header.seq, message.header.stamp_ns, message.header.frame_id),
        (7, STAMP, b"livox_frame".as_slice())
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
fn check_cloud(bytes: &[u8], decoded: &Value, timed: bool) {
    let cloud = PointCloud2::parse(bytes).unwrap();
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
fn check_imu(bytes: &[u8], decoded: &Value) {
    let imu = Imu::parse(bytes).unwrap();
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
        check_custom(&hex(&messages["custom"]["ros1_hex"]), &golden["decoded"]);
        check_cloud(&hex(&messages["pc2_driver1"]["ros1_hex"]), &golden["decoded"], false);
        check_cloud(&hex(&messages["pc2_driver2"]["ros1_hex"]), &golden["decoded"], true);
        check_imu(&hex(&messages["imu"]["ros1_hex"]), &golden["decoded"]);
    }
}

#[test]
fn messages_that_end_too_early_are_refused() {
    let Some(golden) = golden() else { return };
    for name in ["custom", "pc2_driver1", "pc2_driver2", "imu"] {
        let bytes = hex(&golden["livox_ros_driver"][name]["ros1_hex"]);
        // A PointCloud2 ends with its flag is_dense, which nobody needs.
        for length in 0..bytes.len() - 1 {
            let cut = &bytes[..length];
            let refused = match name {
                "custom" => CustomMsg::parse(cut).is_err(),
                "imu" => Imu::parse(cut).is_err(),
                _ => PointCloud2::parse(cut).is_err(),
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
        let mut reader = BagReader::new(&index, &[connection.id]).unwrap();
        let mut count = 0;
        while let Some(message) = reader.next_message().unwrap() {
            assert_eq!(message.connection, connection.id);
            match connection.type_name.as_str() {
                Imu::TYPE => check_imu(message.data, &golden["decoded"]),
                PointCloud2::TYPE => {
                    let timed = PointCloud2::parse(message.data).unwrap().has_time();
                    check_cloud(message.data, &golden["decoded"], timed);
                }
                name if CustomMsg::TYPES.contains(&name) => check_custom(message.data, &golden["decoded"]),
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
        let mut reader = BagReader::new(&index, &wanted).unwrap();
        let (mut last, mut count) = (i64::MIN, 0);
        while let Some(message) = reader.next_message().unwrap() {
            assert!(message.time_ns >= last);
            last = message.time_ns;
            count += 1;
        }
        assert_eq!(count, 220 * seconds);
    }
}
