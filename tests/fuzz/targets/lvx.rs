//! LVX 1.0, 1.1 and LVX2.
#![no_main]

use evac_formats::lvx::LvxReader;
use evac_formats::{livox_sdk1, livox_sdk2};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let path = std::env::temp_dir().join(format!("evac-fuzz-lvx-{}", std::process::id()));
    std::fs::write(&path, bytes).expect("the temporary folder can be written to");
    for tolerant in [false, true] {
        let Ok(reader) = LvxReader::open(&path) else { return };
        let mut reader = reader.tolerate_truncation(tolerant);
        let mut packets = 0;
        while let Ok(Some(packet)) = reader.next_packet() {
            let _ = livox_sdk1::Datagram::parse(packet.datagram);
            let _ = livox_sdk2::Datagram::parse_unchecked(packet.datagram);
            packets += 1;
            assert!(packets <= bytes.len(), "more packets than bytes");
        }
    }
});
