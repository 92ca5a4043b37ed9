//! Values inside payloads.

/// Which echoes of a shot a device sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum ReturnMode {
    /// The first.
    First = 0,
    /// The strongest.
    Strongest = 1,
    /// Two.
    Dual = 2,
    /// Three (Avia).
    Triple = 3,
}

impl ReturnMode {
    /// The mode of a byte.
    pub fn from_wire(value: u8) -> Option<Self> {
        Some(match value {
            0 => Self::First,
            1 => Self::Strongest,
            2 => Self::Dual,
            3 => Self::Triple,
            _ => return None,
        })
    }
}

/// What a device does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum WorkState {
    /// Starts up.
    Initialising = 0,
    /// Can measure.
    Normal = 1,
    /// Saves power.
    PowerSaving = 2,
    /// Waits.
    Standby = 3,
    /// Faulty.
    Error = 4,
}

impl WorkState {
    /// The state of a byte.
    pub fn from_wire(value: u8) -> Option<Self> {
        Some(match value {
            0 => Self::Initialising,
            1 => Self::Normal,
            2 => Self::PowerSaving,
            3 => Self::Standby,
            4 => Self::Error,
            _ => return None,
        })
    }
}

/// Where a device sits, as somebody has told it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extrinsic {
    /// Degrees.
    pub roll_pitch_yaw_deg: [f32; 3],
    /// **Millimetres**.
    pub translation_mm: [i32; 3],
}

impl Extrinsic {
    pub(super) fn read(bytes: &[u8]) -> Option<Self> {
        let [a, b, c, d, e, f] = *<&[u8; 24]>::try_from(bytes).ok()?.as_chunks::<4>().0.first_chunk()?;
        Some(Self {
            roll_pitch_yaw_deg: [a, b, c].map(f32::from_le_bytes),
            translation_mm: [d, e, f].map(i32::from_le_bytes),
        })
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        for angle in self.roll_pitch_yaw_deg {
            out.extend_from_slice(&angle.to_le_bytes());
        }
        for millimetres in self.translation_mm {
            out.extend_from_slice(&millimetres.to_le_bytes());
        }
    }
}

/// A device's own address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Network {
    /// 0 by DHCP, 1 static.
    pub mode: u8,
    /// IPv4 address.
    pub address: [u8; 4],
    /// Mask and gateway; early firmware leaves them out.
    pub mask_and_gateway: Option<([u8; 4], [u8; 4])>,
}

impl Network {
    pub(super) fn read(bytes: &[u8]) -> Option<Self> {
        let (head, rest) = bytes.split_first_chunk::<5>()?;
        let [mode, a, b, c, d] = *head;
        let mask_and_gateway = match rest {
            [] => None,
            [m0, m1, m2, m3, g0, g1, g2, g3] => Some(([*m0, *m1, *m2, *m3], [*g0, *g1, *g2, *g3])),
            _ => return None,
        };
        Some(Self { mode, address: [a, b, c, d], mask_and_gateway })
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        out.push(self.mode);
        out.extend_from_slice(&self.address);
        if let Some((mask, gateway)) = self.mask_and_gateway {
            out.extend_from_slice(&mask);
            out.extend_from_slice(&gateway);
        }
    }
}

/// Time of a pulse, UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UtcTime {
    /// Year less 2000.
    pub year: u8,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
    /// 0 to 23.
    pub hour: u8,
    /// Microseconds since the full hour.
    pub microseconds: u32,
}

impl UtcTime {
    /// A time since 1970 in nanoseconds, to whole microseconds; years before 2000 and after 2255 are cut to the byte that holds them.
    pub fn of_nanoseconds(utc_ns: i64) -> Self {
        let seconds = utc_ns.div_euclid(1_000_000_000);
        let (year, month, day, hour, minute, second) = crate::utc::civil(seconds);
        let whole = (u32::from(minute) * 60 + u32::from(second)) * 1_000_000;
        let microseconds = whole + (utc_ns.rem_euclid(1_000_000_000) / 1000) as u32;
        Self { year: (year - 2000) as u8, month, day, hour, microseconds }
    }

    /// As on the wire, in commands and in the stamps of data.
    pub fn from_bytes([year, month, day, hour, microseconds @ ..]: [u8; 8]) -> Self {
        Self { year, month, day, hour, microseconds: u32::from_le_bytes(microseconds) }
    }

    /// As on the wire.
    pub fn to_bytes(self) -> [u8; 8] {
        let [a, b, c, d] = self.microseconds.to_le_bytes();
        [self.year, self.month, self.day, self.hour, a, b, c, d]
    }
}

/// The status word of data datagrams, heartbeats and status messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Status(pub u32);

impl Status {
    /// Whether the device calls itself faulty (otherwise good or warning).
    pub fn is_error(self) -> bool {
        self.0 >> 30 >= 2
    }

    /// Everything that it says, by name, in words.
    pub fn flags(self) -> [(&'static str, &'static str); 11] {
        let level = |shift: u32, words: [&'static str; 3]| words[(self.0 >> shift & 3).min(2) as usize];
        let bit = |shift: u32, words: [&'static str; 2]| words[(self.0 >> shift & 1) as usize];
        let sync = ["none", "ptp", "gps", "pps", "abnormal"].get((self.0 >> 14 & 7) as usize);
        [
            ("temperature", level(0, ["ok", "high or low", "extreme"])),
            ("voltage", level(2, ["ok", "high", "extreme"])),
            ("motor", level(4, ["ok", "warning", "error"])),
            ("window", level(6, ["ok", "dirty or blocked", "dirty or blocked"])),
            ("firmware", bit(8, ["ok", "abnormal"])),
            ("pulse", bit(9, ["absent", "present"])),
            ("end_of_life", bit(10, ["no", "near"])),
            ("fan", bit(11, ["ok", "warning"])),
            ("heating", bit(12, ["off", "on"])),
            ("time_sync", sync.copied().unwrap_or("unknown")),
            ("system", level(30, ["ok", "warning", "error"])),
        ]
    }

    /// What the device complains of, in words for people; nothing where all is well.
    pub fn complaints(self) -> impl Iterator<Item = &'static str> {
        let level = |shift: u32, names: [&'static str; 2]| match self.0 >> shift & 3 {
            0 => None,
            1 => Some(names[0]),
            _ => Some(names[1]),
        };
        let bit = |shift: u32, name: &'static str| (self.0 >> shift & 1 == 1).then_some(name);
        [
            level(0, ["temperature high or low", "temperature extreme"]),
            level(2, ["voltage high", "voltage extreme"]),
            level(4, ["motor warning", "motor error"]),
            level(6, ["dirty or blocked window", "dirty or blocked window"]),
            bit(8, "firmware abnormal"),
            bit(10, "end of life near"),
            bit(11, "fan warning"),
            bit(12, "heating itself"),
            (self.0 >> 14 & 7 == 4).then_some("time synchronisation abnormal"),
            level(30, ["system warning", "system error"]),
        ]
        .into_iter()
        .flatten()
    }
}
