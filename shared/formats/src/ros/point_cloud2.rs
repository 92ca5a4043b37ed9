//! `sensor_msgs/PointCloud2`, whatever its fields are: each is found by name, datatype and offset.

use super::wire::{Encoding, Header, MessageError, Wire};
use super::writer::{Stamp, Writer};

/// Names under which drivers publish the time of a point.
const TIME_NAMES: [&[u8]; 5] = [b"offset_time", b"t", b"time", b"timestamp", b"time_stamp"];
const INTENSITY_NAMES: [&[u8]; 2] = [b"intensity", b"reflectivity"];

/// A cloud of points.
#[derive(Debug, Clone, Copy)]
pub struct PointCloud2<'a> {
    /// Time of the cloud; by most drivers that of its first point.
    pub header: Header<'a>,
    width: u32,
    height: u32,
    point_step: u32,
    row_step: u32,
    big_endian: bool,
    data: &'a [u8],
    xyz: [Field; 3],
    intensity: Option<Field>,
    time: Option<Field>,
}

/// One point of a [`PointCloud2`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// Metres; may be the origin or not finite where nothing came back.
    pub position: [f32; 3],
    /// Reflectivity, cut to 0..255; 0 where the cloud has none.
    pub intensity: u8,
    /// Raw value of the field of time in the cloud's own unit, see [`TimeUnit`]; `None` where the cloud has none.
    pub time: Option<f64>,
}

/// Unit of a cloud's field of time. Drivers use all of these, in fields that do not say which.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeUnit {
    /// 1 s.
    Seconds,
    /// 1e-3 s.
    Milliseconds,
    /// 1e-6 s.
    Microseconds,
    /// 1e-9 s.
    Nanoseconds,
}

impl TimeUnit {
    /// The unit in which a frame that lasts `spread` units lasts between 1 ms and 1 s; `None` if there is none.
    pub fn of_frame(spread: f64) -> Option<Self> {
        [Self::Seconds, Self::Milliseconds, Self::Microseconds, Self::Nanoseconds]
            .into_iter()
            .find(|unit| (1e6..1e9).contains(&(spread * unit.nanoseconds())))
    }

    /// Nanoseconds of one unit.
    pub fn nanoseconds(self) -> f64 {
        match self {
            Self::Seconds => 1e9,
            Self::Milliseconds => 1e6,
            Self::Microseconds => 1e3,
            Self::Nanoseconds => 1.0,
        }
    }
}

impl<'a> PointCloud2<'a> {
    /// The message type with this layout.
    pub const TYPE: &'static str = "sensor_msgs/PointCloud2";

    /// Checks a serialised message.
    ///
    /// # Errors
    /// [`MessageError`]: cut off, without coordinates, or with steps that do not fit its data.
    pub fn parse(bytes: &'a [u8], encoding: Encoding) -> Result<Self, MessageError> {
        let mut wire = Wire::new(bytes, encoding)?;
        let header = wire.header()?;
        let (height, width) = (wire.u32()?, wire.u32()?);
        let (mut xyz, mut intensity, mut time) = ([None; 3], None, None);
        for _ in 0..wire.u32()? {
            let name = wire.string()?;
            let (offset, datatype, _count) = (wire.u32()?, wire.u8()?, wire.u32()?);
            let Some(field) = Datatype::from_wire(datatype).map(|datatype| Field { offset, datatype }) else {
                continue;
            };
            match name {
                b"x" | b"y" | b"z" if field.datatype.is_float() => {
                    if let Some(axis) =
                        xyz.get_mut(usize::from(name.first().map_or(0, |letter| letter - b'x')))
                    {
                        *axis = Some(field);
                    }
                }
                name if INTENSITY_NAMES.contains(&name) => intensity = Some(field),
                name if TIME_NAMES.contains(&name) => time = Some(field),
                _ => {}
            }
        }
        let big_endian = wire.u8()? != 0;
        let (point_step, row_step) = (wire.u32()?, wire.u32()?);
        let data = wire.counted_bytes()?;
        let [x, y, z] = xyz;
        let xyz = [
            x.ok_or(MessageError::MissingField("x"))?,
            y.ok_or(MessageError::MissingField("y"))?,
            z.ok_or(MessageError::MissingField("z"))?,
        ];
        let cloud =
            Self { header, width, height, point_step, row_step, big_endian, data, xyz, intensity, time };
        if !cloud.fits() {
            return Err(MessageError::Layout { width, height, point_step, row_step, bytes: data.len() });
        }
        Ok(cloud)
    }

    /// Points in the cloud.
    pub fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether the cloud has no points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether points carry a time.
    pub fn has_time(&self) -> bool {
        self.time.is_some()
    }

    /// Point `index`, row by row.
    pub fn point(&self, index: usize) -> Option<CloudPoint> {
        let (row, column) =
            (index.checked_div(self.width as usize)?, index.checked_rem(self.width as usize)?);
        if row >= self.height as usize {
            return None;
        }
        let start = row * self.row_step as usize + column * self.point_step as usize;
        let bytes = self.data.get(start..start + self.point_step as usize)?;
        let value = |field: Field| field.read(bytes, self.big_endian);
        let [x, y, z] = self.xyz;
        Some(CloudPoint {
            position: [value(x)? as f32, value(y)? as f32, value(z)? as f32],
            // `as` saturates and takes NaN as 0.
            intensity: self.intensity.and_then(value).map_or(0, |v| v.round() as u8),
            time: self.time.and_then(value),
        })
    }

    /// Whether every field of every point lies inside the data.
    fn fits(&self) -> bool {
        let fields = self.xyz.into_iter().chain(self.intensity).chain(self.time);
        let inside = |field: Field| {
            u64::from(field.offset) + field.datatype.bytes() as u64 <= u64::from(self.point_step)
        };
        let (width, height) = (u64::from(self.width), u64::from(self.height));
        let row = width * u64::from(self.point_step);
        let needed = match (width, height) {
            (0, _) | (_, 0) => Some(0),
            (_, 1) => Some(row),
            _ if row > u64::from(self.row_step) => None,
            _ => (height - 1).checked_mul(u64::from(self.row_step)).and_then(|rows| rows.checked_add(row)),
        };
        { fields }.all(inside) && needed.is_some_and(|needed| needed <= self.data.len() as u64)
    }
}

#[derive(Debug, Clone, Copy)]
struct Field {
    offset: u32,
    datatype: Datatype,
}

impl Field {
    fn read(self, point: &[u8], big_endian: bool) -> Option<f64> {
        let bytes = point.get(self.offset as usize..)?;
        macro_rules! number {
            ($kind:ty) => {{
                let bytes = *bytes.first_chunk()?;
                if big_endian {
                    <$kind>::from_be_bytes(bytes) as f64
                } else {
                    <$kind>::from_le_bytes(bytes) as f64
                }
            }};
        }
        Some(match self.datatype {
            Datatype::I8 => number!(i8),
            Datatype::U8 => number!(u8),
            Datatype::I16 => number!(i16),
            Datatype::U16 => number!(u16),
            Datatype::I32 => number!(i32),
            Datatype::U32 => number!(u32),
            Datatype::F32 => number!(f32),
            Datatype::F64 => number!(f64),
        })
    }
}

/// `sensor_msgs/PointField` datatypes 1 to 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Datatype {
    /// INT8
    I8 = 1,
    /// UINT8
    U8 = 2,
    /// INT16
    I16 = 3,
    /// UINT16
    U16 = 4,
    /// INT32
    I32 = 5,
    /// UINT32
    U32 = 6,
    /// FLOAT32
    F32 = 7,
    /// FLOAT64
    F64 = 8,
}

/// One `sensor_msgs/PointField` of a cloud that is written.
#[derive(Debug, Clone, Copy)]
pub struct CloudField {
    /// Name, as other programs look for it.
    pub name: &'static str,
    /// Bytes from the start of a point.
    pub offset: u32,
    /// Kind of number.
    pub datatype: Datatype,
}

/// Appends a serialised cloud of one row and `count` points of `point_step` bytes to `out`; `fill` appends them all,
/// little-endian.
pub fn write_cloud(
    out: &mut Vec<u8>,
    encoding: Encoding,
    header: &Stamp<'_>,
    fields: &[CloudField],
    point_step: u32,
    count: u32,
    fill: impl FnOnce(&mut Vec<u8>),
) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    writer.u32(1);
    writer.u32(count);
    writer.u32(fields.len() as u32);
    for field in fields {
        writer.string(field.name);
        writer.u32(field.offset);
        writer.u8(field.datatype as u8);
        writer.u32(1);
    }
    writer.u8(0); // little-endian
    let row = point_step.saturating_mul(count);
    writer.u32(point_step);
    writer.u32(row);
    writer.u32(row);
    let end = out.len() + row as usize;
    fill(out);
    debug_assert_eq!(out.len(), end);
    // Whatever was filled in, the message is as long as it says.
    out.resize(end, 0);
    out.push(1); // all points are valid
}

impl Datatype {
    fn from_wire(value: u8) -> Option<Self> {
        let all = [Self::I8, Self::U8, Self::I16, Self::U16, Self::I32, Self::U32, Self::F32, Self::F64];
        all.get(usize::from(value).checked_sub(1)?).copied()
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}
