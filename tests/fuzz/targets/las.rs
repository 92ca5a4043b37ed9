//! LAS and LAZ.
//!
//! The reader catches panics of the decoder of LAZ (crate `laz`), which trusts its tables, and reports damage. libFuzzer's hook
//! would abort before that, so panics from there pass it; those of our own do not.
#![no_main]

use std::io::Cursor;
use std::panic;
use std::path::Path;
use std::sync::Once;

use evac_formats::las::Reader;

/// Points that are decoded of one file: a compressed one may announce 2^64.
const MOST: usize = 1_000;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let abort = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !panic.location().is_some_and(|place| place.file().contains("/laz-")) {
                abort(panic);
            }
        }));
    });
    let Ok(reader) = Reader::new(Cursor::new(bytes.to_vec()), Path::new("fuzz")) else { return };
    let announced = reader.header().points;
    let read = reader.take(MOST).map_while(Result::ok).count() as u64;
    assert!(read <= announced);
});
