//! What tests of damaged files share.

use proptest::prelude::*;

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
