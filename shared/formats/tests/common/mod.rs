//! What tests share.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses some of it")]

use proptest::prelude::*;
use serde_json::Value;

/// Bytes of a golden file's hexadecimal text.
pub(crate) fn hex(text: &Value) -> Vec<u8> {
    let text = text.as_str().unwrap();
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
}

/// A golden file, where it is there.
pub(crate) fn json(relative: &str) -> Option<Value> {
    let path = evac_testkit::data(relative)?;
    Some(serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap())
}

/// Bytes with some overwritten, singly or by the extremes of a 32-bit word, and then cut.
pub(crate) fn damaged(good: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let length = good.len();
    let word = prop_oneof![
        3 => any::<u8>().prop_map(|byte| vec![byte]),
        1 => prop::sample::select(vec![0_u32, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_fffe, 0xffff_ffff])
            .prop_map(|word| word.to_le_bytes().to_vec()),
    ];
    let changes = proptest::collection::vec((0..length, word), 0..24);
    (changes, 0..=length).prop_map(move |(changes, cut)| {
        let mut bytes = good.clone();
        for (at, word) in changes {
            for (to, from) in bytes[at..].iter_mut().zip(word) {
                *to = from;
            }
        }
        // Half of the cases keep their whole length.
        bytes.truncate(if cut % 2 == 0 { length } else { cut });
        bytes
    })
}
