//! The RS485 variant (WT901C485): Modbus RTU. The host asks, the module answers; words are big-endian, the sum is CRC-16/MODBUS
//! with its low byte first.

/// Address that modules leave the factory with.
pub const ADDRESS: u8 = 0x50;
/// Bytes of every request.
pub const REQUEST_BYTES: usize = 8;
/// Most registers that one reply carries here: those of [`super::register::VALUES`].
pub const MAX_REGISTERS: usize = 16;
/// Bytes of the longest reply.
pub const MAX_REPLY_BYTES: usize = 5 + 2 * MAX_REGISTERS;

const READ: u8 = 0x03;
const WRITE: u8 = 0x06;

/// CRC-16/MODBUS.
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0xa001 } else { 0 })
    })
}

/// A request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Asks for `count` registers from `first` on.
    Read {
        /// First register.
        first: u8,
        /// How many.
        count: u8,
    },
    /// Sets a register.
    Write {
        /// Register.
        register: u8,
        /// Value.
        value: u16,
    },
}

impl Request {
    /// Its bytes for the module at `address`.
    pub fn bytes(self, address: u8) -> [u8; REQUEST_BYTES] {
        let (function, register, value) = match self {
            Self::Read { first, count } => (READ, first, u16::from(count)),
            Self::Write { register, value } => (WRITE, register, value),
        };
        let [high, low] = value.to_be_bytes();
        let [sum_low, sum_high] = crc16(&[address, function, 0, register, high, low]).to_le_bytes();
        [address, function, 0, register, high, low, sum_low, sum_high]
    }

    /// Reads a request to the module at `address`; `None` for one to another, of another kind, or with a wrong sum.
    pub fn parse(bytes: &[u8; REQUEST_BYTES], address: u8) -> Option<Self> {
        let [to, function, 0, register, high, low, _, _] = *bytes else { return None };
        let value = u16::from_be_bytes([high, low]);
        let request = match function {
            READ => Self::Read { first: register, count: u8::try_from(value).ok()? },
            WRITE => Self::Write { register, value },
            _ => return None,
        };
        (to == address && request.bytes(address) == *bytes).then_some(request)
    }
}

/// Writes the reply to a read into `buffer` and gives its length; `None` for more than [`MAX_REGISTERS`].
pub fn encode_reply(address: u8, registers: &[u16], buffer: &mut [u8; MAX_REPLY_BYTES]) -> Option<usize> {
    let length = 3 + 2 * registers.len();
    let (head, rest) = buffer.split_at_mut(3);
    head.copy_from_slice(&[address, READ, u8::try_from(2 * registers.len()).ok()?]);
    let words = rest.get_mut(..2 * registers.len())?;
    for (word, register) in words.chunks_exact_mut(2).zip(registers) {
        word.copy_from_slice(&register.to_be_bytes());
    }
    let sum = crc16(buffer.get(..length)?).to_le_bytes();
    buffer.get_mut(length..length + 2)?.copy_from_slice(&sum);
    Some(length + 2)
}

/// Collects the reply to a read of `count` registers from the module at `address`.
#[derive(Debug, Clone)]
pub struct ReplyParser {
    address: u8,
    count: usize,
    window: [u8; MAX_REPLY_BYTES],
    filled: usize,
    skipped: u64,
}

impl ReplyParser {
    /// Waits for `count` registers, at most [`MAX_REGISTERS`].
    pub fn new(address: u8, count: usize) -> Self {
        Self { address, count: count.min(MAX_REGISTERS), window: [0; MAX_REPLY_BYTES], filled: 0, skipped: 0 }
    }

    /// Takes in one byte; when it completes a reply, its registers (the first `count` of the array).
    pub fn push(&mut self, byte: u8) -> Option<[u16; MAX_REGISTERS]> {
        *self.window.get_mut(self.filled)? = byte;
        self.filled += 1;
        while self.filled > 0 && !self.may_begin() {
            self.drop_first();
        }
        let length = 5 + 2 * self.count;
        if self.filled < length {
            return None;
        }
        let (body, sum) = (self.window.get(..length - 2)?, self.window.get(length - 2..length)?);
        if crc16(body).to_le_bytes() != sum {
            self.drop_first();
            while self.filled > 0 && !self.may_begin() {
                self.drop_first();
            }
            return None;
        }
        let mut registers = [0; MAX_REGISTERS];
        for (register, word) in registers.iter_mut().zip(self.window.get(3..length - 2)?.chunks_exact(2)) {
            *register = word.try_into().map_or(0, u16::from_be_bytes);
        }
        self.filled = 0;
        Some(registers)
    }

    /// Forgets an unfinished reply: what comes next answers another request.
    pub fn restart(&mut self) {
        self.skipped += self.filled as u64;
        self.filled = 0;
    }

    /// Bytes that belong to no reply, so far.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    fn may_begin(&self) -> bool {
        let head = [self.address, READ, (2 * self.count) as u8];
        self.window.iter().take(self.filled).zip(head).all(|(byte, expected)| *byte == expected)
    }

    fn drop_first(&mut self) {
        self.window.copy_within(1.., 0);
        self.filled -= 1;
        self.skipped += 1;
    }
}
