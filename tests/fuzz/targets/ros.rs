//! Messages of ROS 1 and ROS 2.
#![no_main]

use evac_formats::ros::{CustomMsg, Encoding, Imu, PointCloud2, octets};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for encoding in [Encoding::Ros1, Encoding::Cdr] {
        let _ = octets(bytes, encoding);
        let _ = Imu::parse(bytes, encoding);
        if let Ok(custom) = CustomMsg::parse(bytes, encoding) {
            assert!(custom.is_empty() || custom.point(custom.len() - 1).is_some());
        }
        if let Ok(cloud) = PointCloud2::parse(bytes, encoding) {
            assert!(cloud.is_empty() || cloud.point(cloud.len() - 1).is_some());
        }
    }
});
