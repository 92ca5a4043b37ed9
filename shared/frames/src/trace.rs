//! When one frame passed one stage.

use crate::layout::frame;

frame! {
    /// A stage's word on `trace/frame` about a frame that it is done with; said only while somebody reads it. All times are
    /// host monotonic nanoseconds.
    "evac.Trace.v1", 88 bytes,
    pub struct Trace {
        /// Instance name, UTF-8, zero padded.
        pub name: [u8; 32],
        /// Number of the scan.
        pub seq: u64,
        /// When the scan's last byte came in.
        pub arrival_ns: i64,
        /// When the stage before handed its frame over.
        pub sent_ns: i64,
        /// When this stage had that frame; 0 where it is not known any more.
        pub received_ns: i64,
        /// When the frame had all its partners and the stage took it up.
        pub begun_ns: i64,
        /// When the stage had handed over its own output, or was done with its files.
        pub done_ns: i64,
        /// Instance epoch.
        pub epoch: u32,
        /// Always zero.
        pub reserved: u32,
    }
}
