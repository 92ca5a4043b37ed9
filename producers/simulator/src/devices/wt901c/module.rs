//! The module: registers, commands in, frames out.

use evac_formats::wt901c::modbus::{self, MAX_REPLY_BYTES, REQUEST_BYTES, Request};
use evac_formats::wt901c::{
    Command, CommandParser, Scales, baud, content, encode_accel, encode_gyro, encode_time, encode_words, id,
    rate_hz, register,
};

/// Where the module's own clock starts, nanoseconds since 1970: an arbitrary date (2015-01-01).
const CLOCK_START_NS: i64 = 1_420_070_400_000_000_000;
/// How long a key unlocks writing, nanoseconds.
const UNLOCKED_NS: i64 = 10_000_000_000;
const REGISTERS: usize = 128;

/// What the module is connected by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// TTL or RS232: it streams.
    Serial,
    /// RS485: it answers at this address.
    Modbus(u8),
}

/// A WT901C without its line.
#[derive(Debug, Clone)]
pub struct Module {
    line: Line,
    registers: [u16; REGISTERS],
    saved: [u16; REGISTERS],
    unlocked_until_ns: i64,
    commands: CommandParser,
    request: Vec<u8>,
    /// Added to the host's clock for the module's.
    clock_ns: i64,
    ppm: f64,
    next_ns: i64,
    /// Until when its line is busy with what it has sent.
    busy_until_ns: i64,
    yaw: f64,
    measured_ns: Option<i64>,
}

impl Module {
    /// As from the factory: 9600 baud, 10 Hz, accelerometer, gyroscope, angles and magnetometer, 21 Hz of bandwidth.
    pub fn new(line: Line) -> Self {
        let mut registers = [0; REGISTERS];
        for (register, value) in [
            (register::CONTENT, content::ACCEL | content::GYRO | content::ANGLE | content::MAGNETOMETER),
            (register::RATE, 6),
            (register::BAUD, 2),
            (register::BANDWIDTH, 4),
            (register::VERSION, 0x3085),
        ] {
            registers[usize::from(register)] = value;
        }
        Self {
            line,
            saved: registers,
            registers,
            unlocked_until_ns: i64::MIN,
            commands: CommandParser::default(),
            request: Vec::with_capacity(REQUEST_BYTES),
            clock_ns: CLOCK_START_NS,
            ppm: 0.0,
            next_ns: i64::MIN,
            busy_until_ns: i64::MIN,
            yaw: 0.0,
            measured_ns: None,
        }
    }

    /// As it leaves a workshop: these settings saved, the clock slow by `ppm`.
    #[must_use]
    pub fn configured(mut self, settings: &[(u8, u16)], ppm: f64) -> Self {
        for (register, value) in settings {
            self.set(*register, *value);
        }
        self.saved = self.registers;
        self.ppm = ppm;
        self
    }

    /// Speed that it talks at now.
    pub fn baud(&self) -> u32 {
        baud(self.register(register::BAUD)).unwrap_or(9600)
    }

    /// Value of a register.
    pub fn register(&self, register: u8) -> u16 {
        self.registers.get(usize::from(register)).copied().unwrap_or(0)
    }

    /// Its clock is set forward by this much, nanoseconds.
    pub fn step_clock(&mut self, by_ns: i64) {
        self.clock_ns += by_ns;
    }

    /// Off and on again: what was not saved is forgotten.
    pub fn power_cycle(&mut self) {
        self.registers = self.saved;
        self.unlocked_until_ns = i64::MIN;
        self.clock_ns = CLOCK_START_NS;
        self.next_ns = i64::MIN;
        (self.commands, self.request) = (CommandParser::default(), Vec::with_capacity(REQUEST_BYTES));
    }

    /// A byte from the host; what it answers goes to `out`.
    pub fn hear(&mut self, byte: u8, now_ns: i64, out: &mut Vec<u8>) {
        match self.line {
            Line::Serial => {
                if let Some(command) = self.commands.push(byte) {
                    self.obey(command, now_ns, out);
                }
            }
            Line::Modbus(address) => self.hear_request(byte, address, now_ns, out),
        }
    }

    /// A measurement at `now_ns` of the host's clock; if a sample is due it goes to `out`.
    pub fn measure(&mut self, now_ns: i64, accel: [i16; 3], gyro: [i16; 3], out: &mut Vec<u8>) {
        self.keep(now_ns, accel, gyro);
        let Some(rate) = rate_hz(self.register(register::RATE)).filter(|_| self.line == Line::Serial) else {
            return;
        };
        let period_ns = (1e9 / rate) as i64;
        // Half a period of the feeder's 200 Hz early is not early.
        if now_ns < self.next_ns.saturating_sub(2_500_000) || now_ns < self.busy_until_ns {
            return;
        }
        self.next_ns = if self.next_ns < now_ns - period_ns { now_ns } else { self.next_ns } + period_ns;
        let before = out.len();
        self.send(now_ns, out);
        // A line that is too slow for the rate lowers it, as the manual says.
        let bytes = (out.len() - before) as i64;
        self.busy_until_ns = now_ns + bytes * 10_000_000_000 / i64::from(self.baud()) - 2_500_000;
    }

    fn keep(&mut self, now_ns: i64, accel: [i16; 3], gyro: [i16; 3]) {
        let elapsed_s = self.measured_ns.map_or(0.0, |then| (now_ns - then) as f64 * 1e-9);
        self.measured_ns = Some(now_ns);
        let [_, _, rate_z] = Scales::default().gyro(gyro);
        self.yaw += rate_z * elapsed_s;
        self.yaw -= (self.yaw / std::f64::consts::TAU).round() * std::f64::consts::TAU;
        let [x, y, z] = accel.map(f64::from);
        let angles = [y.atan2(z), (-x).atan2(y.hypot(z)), self.yaw];
        let angles = angles.map(|angle| (angle / std::f64::consts::PI * 32768.0) as i16);
        let values = [accel, gyro, [120, -340, 560], angles];
        for (offset, value) in values.as_flattened().iter().enumerate() {
            self.registers[usize::from(register::VALUES) + offset] = value.cast_unsigned();
        }
        self.registers[usize::from(register::VALUES) + 12] = 2534;
    }

    fn send(&self, now_ns: i64, out: &mut Vec<u8>) {
        let wanted = self.register(register::CONTENT);
        let value = |offset: u8| self.register(register::VALUES + offset).cast_signed();
        let triple = |offset: u8| [0, 1, 2].map(|axis| value(offset + axis));
        let words = |offset: u8, last: i16| {
            let [x, y, z] = triple(offset);
            [x, y, z, last]
        };
        if wanted & content::TIME != 0 {
            let time_ns = self.clock_ns + (now_ns as f64 * (1.0 - self.ppm * 1e-6)) as i64;
            out.extend(encode_time(time_ns).into_iter().flatten());
        }
        if wanted & content::ACCEL != 0 {
            out.extend(encode_accel(triple(0), value(12)));
        }
        if wanted & content::GYRO != 0 {
            out.extend(encode_gyro(triple(3), 500));
        }
        if wanted & content::ANGLE != 0 {
            out.extend(encode_words(id::ANGLE, words(9, self.register(register::VERSION).cast_signed())));
        }
        if wanted & content::MAGNETOMETER != 0 {
            out.extend(encode_words(id::MAGNETOMETER, words(6, value(12))));
        }
        if wanted & content::QUATERNION != 0 {
            let half = triple(9).map(|word| f64::from(word) / 32768.0 * std::f64::consts::PI / 2.0);
            out.extend(encode_words(id::QUATERNION, quaternion(half)));
        }
    }

    fn obey(&mut self, command: Command, now_ns: i64, out: &mut Vec<u8>) {
        match command.register {
            register::READ => {
                let first = command.value as u8;
                let words =
                    [0, 1, 2, 3].map(|offset| self.register(first.wrapping_add(offset)).cast_signed());
                out.extend(encode_words(id::REGISTERS, words));
            }
            _ => self.write(command, now_ns),
        }
    }

    fn write(&mut self, command: Command, now_ns: i64) {
        if command == Command::UNLOCK {
            self.unlocked_until_ns = now_ns + UNLOCKED_NS;
        } else if now_ns > self.unlocked_until_ns {
            // Silently, as the module does.
        } else if command == Command::SAVE {
            self.saved = self.registers;
        } else if command == Command::RESTART {
            self.power_cycle();
        } else {
            self.set(command.register, command.value);
        }
    }

    fn set(&mut self, register: u8, value: u16) {
        let allowed = match register {
            register::RATE => rate_hz(value).is_some(),
            register::BAUD => baud(value).is_some(),
            // What it measures cannot be set.
            register::VERSION..=0x54 => false,
            _ => true,
        };
        if let Some(slot) = self.registers.get_mut(usize::from(register)).filter(|_| allowed) {
            *slot = value;
        }
    }

    fn hear_request(&mut self, byte: u8, address: u8, now_ns: i64, out: &mut Vec<u8>) {
        self.request.push(byte);
        let Ok(bytes) = <&[u8; REQUEST_BYTES]>::try_from(self.request.as_slice()) else { return };
        match Request::parse(bytes, address) {
            Some(Request::Read { first, count }) => {
                let registers: Vec<u16> =
                    (0..count).map(|offset| self.register(first.wrapping_add(offset))).collect();
                let mut reply = [0; MAX_REPLY_BYTES];
                if let Some(length) = modbus::encode_reply(address, &registers, &mut reply) {
                    out.extend(&reply[..length]);
                }
                self.request.clear();
            }
            Some(Request::Write { register, value }) => {
                out.extend(bytes);
                self.write(Command::write(register, value), now_ns);
                self.request.clear();
            }
            None => {
                self.request.remove(0);
            }
        }
    }
}

/// From half the roll, pitch and yaw; w, x, y, z.
fn quaternion([roll, pitch, yaw]: [f64; 3]) -> [i16; 4] {
    let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
    [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    .map(|value| (value * 32768.0) as i16)
}
