//! A row's bytes: a header of types, then the values.

use std::ops::Range;

/// A value of a row. Texts and blobs are places in the row's bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Value {
    /// Nothing, a number with a point, or the row's own number.
    Other,
    /// A number.
    Integer(i64),
    /// A text.
    Text(Range<usize>),
    /// Bytes.
    Blob(Range<usize>),
}

impl Value {
    /// The number.
    pub(crate) fn integer(&self) -> Option<i64> {
        match self {
            Self::Integer(value) => Some(*value),
            _ => None,
        }
    }

    /// The place of the bytes.
    pub(crate) fn bytes(&self) -> Option<Range<usize>> {
        match self {
            Self::Text(range) | Self::Blob(range) => Some(range.clone()),
            _ => None,
        }
    }
}

/// A number of one to nine bytes, seven bits each, and how many bytes it has.
pub(super) fn varint(bytes: &[u8]) -> Option<(u64, usize)> {
    let mut value = 0_u64;
    for (at, byte) in bytes.iter().take(9).enumerate() {
        if at == 8 {
            return Some((value << 8 | u64::from(*byte), 9));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Some((value, at + 1));
        }
    }
    None
}

/// The first `N` values of a row, of which `bytes` are the beginning and `length` all; `None` where they are not as they
/// must be, or a number lies beyond `bytes`.
pub(super) fn values<const N: usize>(bytes: &[u8], length: usize) -> Option<[Value; N]> {
    let (header, mut at) = varint(bytes)?;
    let mut body = usize::try_from(header).ok()?;
    let mut values = [const { Value::Other }; N];
    for value in &mut values {
        // Columns added to a table later are missing in older rows.
        if at as u64 >= header {
            break;
        }
        let (kind, size) = varint(bytes.get(at..)?)?;
        at += size;
        let size = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind as usize,
            5 => 6,
            6 | 7 => 8,
            10 | 11 => return None,
            _ => usize::try_from((kind - 12) / 2).ok()?,
        };
        let range = body..body.checked_add(size).filter(|end| *end <= length)?;
        body = range.end;
        *value = match kind {
            0 | 7 => Value::Other,
            8 => Value::Integer(0),
            9 => Value::Integer(1),
            1..=6 => Value::Integer(integer(bytes.get(range)?)),
            _ if kind % 2 == 0 => Value::Blob(range),
            _ => Value::Text(range),
        };
    }
    Some(values)
}

/// Big-endian two's complement of any length.
fn integer(bytes: &[u8]) -> i64 {
    let sign = bytes.first().map_or(0, |first| if first & 0x80 == 0 { 0 } else { -1 });
    bytes.iter().fold(sign, |value, byte| value << 8 | i64::from(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_all_lengths_are_read() {
        assert_eq!(varint(&[0x81, 0x00]), Some((128, 2)));
        assert_eq!(varint(&[0xff; 9]), Some((u64::MAX, 9)));
        assert_eq!(varint(&[0xff; 3]), None);
        assert_eq!(integer(&[0xff, 0xfe]), -2);
        assert_eq!(integer(&[0x7f, 0xff]), 32_767);
    }

    #[test]
    fn a_row_s_values_lie_where_its_types_say() {
        // NULL, 1, a number of two bytes, a text of two and a blob of one byte
        let row = [6, 0, 9, 2, 17, 14, 0xff, 0xfe, b'h', b'i', 7];
        let [null, one, number, text, blob, missing] = values(&row, row.len()).unwrap();
        assert_eq!([null, one, number], [Value::Other, Value::Integer(1), Value::Integer(-2)]);
        assert_eq!([text, blob], [Value::Text(8..10), Value::Blob(10..11)]);
        assert_eq!(missing, Value::Other);
        assert_eq!(values::<5>(&row, 10), None, "the blob is beyond the end");
    }
}
