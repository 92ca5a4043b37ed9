//! OctoMap's `.bt`: read, written, read again, and as a map.
#![no_main]

mod octomap;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| octomap::read_and_write(bytes));
