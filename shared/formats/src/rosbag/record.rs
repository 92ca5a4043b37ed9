//! One record: header length, header fields `name=value`, data length, data.

/// Kinds of records (header field `op`).
pub(super) mod op {
    pub(in crate::rosbag) const MESSAGE: u8 = 0x02;
    pub(in crate::rosbag) const BAG_HEADER: u8 = 0x03;
    pub(in crate::rosbag) const INDEX: u8 = 0x04;
    pub(in crate::rosbag) const CHUNK: u8 = 0x05;
    pub(in crate::rosbag) const CONNECTION: u8 = 0x07;
}

/// The fields of a record's header, or of a connection's data.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    /// The value of the field `name`; `None` if it is absent or the bytes are no fields.
    pub(super) fn get(&self, name: &str) -> Option<&'a [u8]> {
        let mut rest = self.0;
        while !rest.is_empty() {
            let (length, after) = rest.split_first_chunk::<4>()?;
            let (field, after) = after.split_at_checked(u32::from_le_bytes(*length) as usize)?;
            let split = field.iter().position(|byte| *byte == b'=')?;
            let (key, value) = field.split_at_checked(split)?;
            if key == name.as_bytes() {
                return value.get(1..);
            }
            rest = after;
        }
        None
    }

    pub(super) fn op(&self) -> Option<u8> {
        self.get("op")?.first().copied()
    }

    pub(super) fn u32(&self, name: &str) -> Option<u32> {
        Some(u32::from_le_bytes(self.get(name)?.try_into().ok()?))
    }

    pub(super) fn u64(&self, name: &str) -> Option<u64> {
        Some(u64::from_le_bytes(self.get(name)?.try_into().ok()?))
    }

    /// A ROS time: seconds and nanoseconds.
    pub(super) fn time_ns(&self, name: &str) -> Option<i64> {
        let (seconds, nanoseconds) = self.get(name)?.split_first_chunk::<4>()?;
        let nanoseconds = u32::from_le_bytes(nanoseconds.try_into().ok()?);
        Some(i64::from(u32::from_le_bytes(*seconds)) * 1_000_000_000 + i64::from(nanoseconds))
    }

    pub(super) fn text(&self, name: &str) -> Option<String> {
        self.get(name).map(|bytes| String::from_utf8_lossy(bytes).into_owned())
    }
}

/// A record within a chunk, and the bytes after it; `None` where the chunk ends inside it.
pub(super) fn split_record(bytes: &[u8]) -> Option<(Fields<'_>, &[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    let (header, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let (data, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    Some((Fields(header), data, rest))
}
