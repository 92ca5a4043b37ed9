//! Data datagrams of both of Livox's protocols: what a packet says it holds is there, and nothing else.
#![no_main]

use evac_formats::{livox_sdk1, livox_sdk2};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(datagram) = livox_sdk1::Datagram::parse(bytes) {
        let points = datagram.points();
        assert!(points <= bytes.len());
        assert!((0..points).all(|index| datagram.point(index).is_some()) && datagram.point(points).is_none());
        assert_eq!(datagram.imu(0).is_some(), points == 0);
    }
    // Without the checksum, which a fuzzer does not find.
    if let Ok(datagram) = livox_sdk2::Datagram::parse_unchecked(bytes) {
        let points = datagram.points();
        assert!(points <= bytes.len());
        assert!((0..points).all(|index| datagram.point(index).is_some()) && datagram.point(points).is_none());
        assert!(
            (0..datagram.shots()).all(|shot| datagram.shot_offset_ns(shot) <= datagram.header.interval_ns)
        );
    }
    let _ = livox_sdk2::Datagram::parse(bytes);
});
