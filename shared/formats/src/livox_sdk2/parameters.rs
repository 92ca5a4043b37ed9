//! Lists of keys with values: what a device is told, asked and says about itself.

/// Keys that are used here; a list may hold any other.
pub mod key {
    /// Kind of point data, one byte: a [`super::super::DataType`] of points.
    pub const POINT_DATA_TYPE: u16 = 0x0000;
    /// Scan pattern, one byte.
    pub const PATTERN: u16 = 0x0001;
    /// The device's address, mask and gateway, 12 bytes.
    pub const LIDAR_ADDRESS: u16 = 0x0004;
    /// Where pushed information goes: a [`super::super::HostAddress`].
    pub const STATE_HOST: u16 = 0x0005;
    /// Where points go: a [`super::super::HostAddress`].
    pub const POINT_HOST: u16 = 0x0006;
    /// Where IMU samples go: a [`super::super::HostAddress`].
    pub const IMU_HOST: u16 = 0x0007;
    /// Attitude of installation: f32 roll, pitch, yaw in degrees and i32 x, y, z in mm.
    pub const INSTALL_ATTITUDE: u16 = 0x0012;
    /// What the device shall do, one byte: a [`super::WorkState`].
    pub const WORK_TARGET: u16 = 0x001a;
    /// Whether IMU samples are sent, one byte.
    pub const IMU_ENABLED: u16 = 0x001c;
    /// Serial number, 16 bytes.
    pub const SERIAL: u16 = 0x8000;
    /// Product, 64 bytes of text.
    pub const PRODUCT: u16 = 0x8001;
    /// Firmware version, 4 bytes.
    pub const FIRMWARE: u16 = 0x8002;
    /// What the device does, one byte: a [`super::WorkState`].
    pub const WORK_STATE: u16 = 0x8006;
    /// Temperature of the core, i32 in 0.01 degrees Celsius.
    pub const CORE_TEMPERATURE: u16 = 0x8007;
    /// The device's clock, u64 nanoseconds.
    pub const LOCAL_TIME: u16 = 0x8009;
    /// Source of the clock, one byte: a [`super::super::TimeType`].
    pub const TIME_TYPE: u16 = 0x800c;
    /// Four fields of 4 bits (system, scanning, ranging, communication): 0 good, 1 warning, 2 error, 3 safety error.
    pub const DIAGNOSTICS: u16 = 0x800e;
    /// Which firmware runs, one byte: 0 loader, 1 application.
    pub const FIRMWARE_TYPE: u16 = 0x8010;
    /// Codes of the health management system, eight u32.
    pub const HEALTH_CODES: u16 = 0x8011;
}

/// What a device does, or is told to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum WorkState {
    /// Measures and sends.
    Sampling = 1,
    /// Awake, sends nothing.
    Idle = 2,
    /// Asleep (HAP).
    Sleep = 3,
    /// Faulty.
    Error = 4,
    /// Tests itself after power-on.
    SelfCheck = 5,
    /// Its motor starts.
    MotorStart = 6,
    /// Its motor stops.
    MotorStop = 7,
    /// Its firmware is being written.
    Upgrade = 8,
    /// Could measure at once.
    Ready = 9,
}

impl WorkState {
    /// The state of a value's byte.
    pub fn from_wire(value: u8) -> Option<Self> {
        Some(match value {
            1 => Self::Sampling,
            2 => Self::Idle,
            3 => Self::Sleep,
            4 => Self::Error,
            5 => Self::SelfCheck,
            6 => Self::MotorStart,
            7 => Self::MotorStop,
            8 => Self::Upgrade,
            9 => Self::Ready,
            _ => return None,
        })
    }
}

/// A key with its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parameter<'a> {
    /// See [`key`].
    pub key: u16,
    /// Little-endian, of the length that the key has.
    pub value: &'a [u8],
}

impl Parameter<'_> {
    /// The value of a key of one byte.
    pub fn byte(&self) -> Option<u8> {
        match self.value {
            [byte] => Some(*byte),
            _ => None,
        }
    }
}

/// The parameters of a list; ends early where the list is cut, see [`Parameters::is_whole`].
#[derive(Debug, Clone)]
pub struct Parameters<'a> {
    left: &'a [u8],
    count: u16,
}

impl<'a> Parameters<'a> {
    /// The list of a request (0x0100) or of pushed information (0x0102): number, reserved word, entries.
    pub fn of_request(data: &'a [u8]) -> Option<Self> {
        let (head, left) = data.split_first_chunk::<4>()?;
        Some(Self { left, count: u16::from_le_bytes([head[0], head[1]]) })
    }

    /// The return code and the list of the answer to a query (0x0101), which has no reserved word.
    pub fn of_answer(data: &'a [u8]) -> Option<(u8, Self)> {
        let (head, left) = data.split_first_chunk::<3>()?;
        Some((head[0], Self { left, count: u16::from_le_bytes([head[1], head[2]]) }))
    }

    /// The keys that a query (0x0101) asks for.
    pub fn keys_of_query(data: &'a [u8]) -> impl Iterator<Item = u16> + 'a {
        let (head, keys) = data.split_first_chunk::<4>().unwrap_or((&[0; 4], &[]));
        let count = usize::from(u16::from_le_bytes([head[0], head[1]]));
        keys.as_chunks::<2>().0.iter().take(count).map(|bytes| u16::from_le_bytes(*bytes))
    }

    /// The value of a key.
    pub fn get(&self, key: u16) -> Option<Parameter<'a>> {
        self.clone().find(|parameter| parameter.key == key)
    }

    /// Whether the bytes hold exactly the entries that the list says it has.
    pub fn is_whole(&self) -> bool {
        let mut rest = self.clone();
        rest.by_ref().for_each(drop);
        rest.count == 0 && rest.left.is_empty()
    }
}

impl<'a> Iterator for Parameters<'a> {
    type Item = Parameter<'a>;

    fn next(&mut self) -> Option<Parameter<'a>> {
        let count = self.count.checked_sub(1)?;
        let (head, rest) = self.left.split_first_chunk::<4>()?;
        let [k0, k1, l0, l1] = *head;
        let (value, rest) = rest.split_at_checked(usize::from(u16::from_le_bytes([l0, l1])))?;
        (self.left, self.count) = (rest, count);
        Some(Parameter { key: u16::from_le_bytes([k0, k1]), value })
    }
}

/// Writes a list.
#[derive(Debug)]
pub struct ParametersWriter<'a> {
    out: &'a mut Vec<u8>,
    count_at: usize,
    count: u16,
}

impl<'a> ParametersWriter<'a> {
    /// Replaces `out` by the beginning of a request (0x0100) or of pushed information (0x0102).
    pub fn request(out: &'a mut Vec<u8>) -> Self {
        out.clear();
        out.extend_from_slice(&[0; 4]);
        Self { out, count_at: 0, count: 0 }
    }

    /// Replaces `out` by the beginning of an answer (0x0101).
    pub fn answer(return_code: u8, out: &'a mut Vec<u8>) -> Self {
        out.clear();
        out.extend_from_slice(&[return_code, 0, 0]);
        Self { out, count_at: 1, count: 0 }
    }

    /// Replaces `out` by a query (0x0101) for keys.
    pub fn query(keys: &[u16], out: &'a mut Vec<u8>) {
        out.clear();
        out.extend_from_slice(&(keys.len() as u16).to_le_bytes());
        out.extend_from_slice(&[0; 2]);
        for key in keys {
            out.extend_from_slice(&key.to_le_bytes());
        }
    }

    /// Adds an entry; a value longer than 65,535 bytes is left out.
    pub fn put(&mut self, key: u16, value: &[u8]) {
        let Ok(length) = u16::try_from(value.len()) else { return };
        self.out.extend_from_slice(&key.to_le_bytes());
        self.out.extend_from_slice(&length.to_le_bytes());
        self.out.extend_from_slice(value);
        self.count = self.count.saturating_add(1);
        if let Some(to) = self.out.get_mut(self.count_at..self.count_at + 2) {
            to.copy_from_slice(&self.count.to_le_bytes());
        }
    }
}
