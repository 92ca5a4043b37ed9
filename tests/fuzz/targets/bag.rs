//! Bags of all kinds (ROS 1, MCAP, db3) and the messages in them.
#![no_main]

use evac_formats::bag::{Bag, Messages};
use evac_formats::ros::{CustomMsg, Imu, PointCloud2, octets};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // Readers seek, so they take files.
    let path = std::env::temp_dir().join(format!("evac-fuzz-bag-{}", std::process::id()));
    std::fs::write(&path, bytes).expect("the temporary folder can be written to");
    for tolerant in [false, true] {
        let Ok(bag) = Bag::open(&path, tolerant) else { continue };
        for connection in bag.connections() {
            let mut messages = Messages::new(&bag, &[connection.id]);
            let mut count = 0;
            while let Ok(Some(message)) = messages.next_message() {
                let _ = octets(message.data, connection.encoding);
                let _ = Imu::parse(message.data, connection.encoding);
                if let Ok(custom) = CustomMsg::parse(message.data, connection.encoding) {
                    assert!(custom.is_empty() || custom.point(custom.len() - 1).is_some());
                }
                if let Ok(cloud) = PointCloud2::parse(message.data, connection.encoding) {
                    assert!(cloud.is_empty() || cloud.point(cloud.len() - 1).is_some());
                }
                count += 1;
                assert!(count <= 1 << 20, "more messages than bytes");
            }
        }
    }
});
