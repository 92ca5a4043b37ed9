//! What the host says: five bytes `FF AA register low high`, without a sum and without an answer, but for reads.

/// Bytes of every command.
pub const COMMAND_BYTES: usize = 5;
const HEAD: [u8; 2] = [0xff, 0xaa];

/// Addresses of registers.
pub mod register {
    /// Save (0), factory settings (1), restart (0xff).
    pub const SAVE: u8 = 0x00;
    /// Calibration: 1 accelerometer, 7 magnetometer, 8 angle reference, 4 zero yaw, 0 end.
    pub const CALIBRATION: u8 = 0x01;
    /// Which frames a sample has; see [`content`](super::content).
    pub const CONTENT: u8 = 0x02;
    /// Samples per second; see [`rate_code`](super::rate_code).
    pub const RATE: u8 = 0x03;
    /// Speed of the line; see [`baud_code`](super::baud_code).
    pub const BAUD: u8 = 0x04;
    /// Bandwidth of the low-pass filter; see [`bandwidth_code`](super::bandwidth_code).
    pub const BANDWIDTH: u8 = 0x1f;
    /// 0: nine axes, 1: six, without the magnetometer.
    pub const ALGORITHM: u8 = 0x24;
    /// Address to read.
    pub const READ: u8 = 0x27;
    /// Version of the firmware.
    pub const VERSION: u8 = 0x2e;
    /// First of the newest values: accelerometer, gyroscope, magnetometer, angles, temperature.
    pub const VALUES: u8 = 0x34;
    /// Key that unlocks writing for about ten seconds.
    pub const KEY: u8 = 0x69;
}

/// Bits of [`register::CONTENT`].
pub mod content {
    /// Frame 0x50.
    pub const TIME: u16 = 1;
    /// Frame 0x51.
    pub const ACCEL: u16 = 1 << 1;
    /// Frame 0x52.
    pub const GYRO: u16 = 1 << 2;
    /// Frame 0x53.
    pub const ANGLE: u16 = 1 << 3;
    /// Frame 0x54.
    pub const MAGNETOMETER: u16 = 1 << 4;
    /// Frame 0x59.
    pub const QUATERNION: u16 = 1 << 9;
    /// All that exist.
    pub const ALL: u16 = 0x7ff;
}

/// One command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command {
    /// Register that is written.
    pub register: u8,
    /// Value.
    pub value: u16,
}

impl Command {
    /// Allows writing for about ten seconds; the vendor's code waits 20 ms after it.
    pub const UNLOCK: Self = Self { register: register::KEY, value: 0xb588 };
    /// Keeps the settings over a power cycle.
    pub const SAVE: Self = Self { register: register::SAVE, value: 0 };
    /// Restarts the module.
    pub const RESTART: Self = Self { register: register::SAVE, value: 0xff };

    /// Sets a register; only after [`Self::UNLOCK`].
    pub fn write(register: u8, value: u16) -> Self {
        Self { register, value }
    }

    /// Asks for four registers from `first` on; the answer is a frame 0x5f.
    pub fn read(first: u8) -> Self {
        Self { register: register::READ, value: u16::from(first) }
    }

    /// Its bytes.
    pub fn bytes(self) -> [u8; COMMAND_BYTES] {
        let ([first, second], [low, high]) = (HEAD, self.value.to_le_bytes());
        [first, second, self.register, low, high]
    }
}

/// Finds commands in bytes, as the module does: for simulated ones.
#[derive(Debug, Clone, Default)]
pub struct CommandParser {
    window: [u8; COMMAND_BYTES],
    filled: usize,
}

impl CommandParser {
    /// Takes in one byte; a command when it completes one.
    pub fn push(&mut self, byte: u8) -> Option<Command> {
        let expected = HEAD.get(self.filled);
        if expected.is_some_and(|expected| *expected != byte) {
            self.filled = usize::from(byte == HEAD[0]);
            return None;
        }
        *self.window.get_mut(self.filled)? = byte;
        self.filled += 1;
        if self.filled < COMMAND_BYTES {
            return None;
        }
        self.filled = 0;
        let [_, _, register, low, high] = self.window;
        Some(Command { register, value: u16::from_le_bytes([low, high]) })
    }
}

/// Rates in Hz with their codes; 125 Hz only on some models.
const RATES: [(f64, u16); 10] = [
    (0.2, 1),
    (0.5, 2),
    (1.0, 3),
    (2.0, 4),
    (5.0, 5),
    (10.0, 6),
    (20.0, 7),
    (50.0, 8),
    (100.0, 9),
    (200.0, 0x0b),
];
const BAUDS: [(u32, u16); 9] = [
    (4800, 1),
    (9600, 2),
    (19_200, 3),
    (38_400, 4),
    (57_600, 5),
    (115_200, 6),
    (230_400, 7),
    (460_800, 8),
    (921_600, 9),
];
const BANDWIDTHS: [(u32, u16); 7] = [(256, 0), (184, 1), (94, 2), (44, 3), (21, 4), (10, 5), (5, 6)];

/// Code of a rate in Hz.
pub fn rate_code(rate_hz: f64) -> Option<u16> {
    RATES.iter().find(|(rate, _)| *rate == rate_hz).map(|(_, code)| *code)
}

/// Rate in Hz of a code.
pub fn rate_hz(code: u16) -> Option<f64> {
    RATES.iter().find(|(_, known)| *known == code).map(|(rate, _)| *rate)
}

/// Code of a line's speed.
pub fn baud_code(baud: u32) -> Option<u16> {
    BAUDS.iter().find(|(known, _)| *known == baud).map(|(_, code)| *code)
}

/// Speed of a line by its code.
pub fn baud(code: u16) -> Option<u32> {
    BAUDS.iter().find(|(_, known)| *known == code).map(|(baud, _)| *baud)
}

/// Code of a bandwidth in Hz.
pub fn bandwidth_code(bandwidth_hz: u32) -> Option<u16> {
    BANDWIDTHS.iter().find(|(known, _)| *known == bandwidth_hz).map(|(_, code)| *code)
}
