//! PLY: ascii and binary of both byte orders.
#![no_main]

use std::path::Path;

use evac_formats::ply::Reader;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(reader) = Reader::new(bytes, Path::new("fuzz")) else { return };
    let announced = reader.points();
    let read = reader.map_while(Result::ok).count() as u64;
    assert!(read <= announced);
});
