//! Commands and the answers that are no list.

use std::net::{Ipv4Addr, SocketAddrV4};

/// Command numbers.
pub mod command {
    /// Who is there? Asked of all, without data; the answer is a [`super::SearchReply`].
    pub const SEARCH: u16 = 0x0000;
    /// Sets a list of parameters; the answer is a [`super::WriteReply`].
    pub const WRITE_PARAMETERS: u16 = 0x0100;
    /// Asks for a list of parameters.
    pub const READ_PARAMETERS: u16 = 0x0101;
    /// A list of parameters that the device sends by itself; not answered.
    pub const PUSH: u16 = 0x0102;
    /// Restarts the device after u16 ms; the answer is a return code.
    pub const REBOOT: u16 = 0x0200;
}

/// Return codes.
pub mod return_code {
    /// Done.
    pub const OK: u8 = 0;
    /// Not done.
    pub const FAILED: u8 = 1;
    /// Not possible in the present state.
    pub const NOT_NOW: u8 = 2;
    /// A value out of range.
    pub const OUT_OF_RANGE: u8 = 3;
    /// A key that the device does not have.
    pub const UNKNOWN_KEY: u8 = 0x20;
    /// A key that cannot be written.
    pub const READ_ONLY: u8 = 0x22;
    /// A value of the wrong length.
    pub const BAD_LENGTH: u8 = 0x23;
}

/// The device's fixed ports of a Mid-360; its packets are told apart by the port that they come from.
pub mod ports {
    /// Search.
    pub const SEARCH: u16 = 56000;
    /// Commands.
    pub const COMMAND: u16 = 56100;
    /// Pushed information.
    pub const PUSH: u16 = 56200;
    /// Points.
    pub const POINTS: u16 = 56300;
    /// IMU samples.
    pub const IMU: u16 = 56400;
}

/// What a device answers to a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SearchReply {
    /// See [`return_code`].
    pub return_code: u8,
    /// 9 Mid-360, 10 and 15 HAP, 35 Mid-360s, 40 Avia 2.
    pub device_type: u8,
    /// Serial number, zero padded.
    pub serial: [u8; 16],
    /// Address and command port of the device.
    pub command: SocketAddrV4,
}

impl SearchReply {
    /// Reads the answer's data.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let (head, rest) = data.split_first_chunk::<2>()?;
        let (serial, rest) = rest.split_first_chunk::<16>()?;
        let [a, b, c, d, p0, p1] = *rest.first_chunk()?;
        let command = SocketAddrV4::new(Ipv4Addr::new(a, b, c, d), u16::from_le_bytes([p0, p1]));
        Some(Self { return_code: head[0], device_type: head[1], serial: *serial, command })
    }

    /// Replaces `out` by the answer's data.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.clear();
        out.extend_from_slice(&[self.return_code, self.device_type]);
        out.extend_from_slice(&self.serial);
        out.extend_from_slice(&self.command.ip().octets());
        out.extend_from_slice(&self.command.port().to_le_bytes());
    }
}

/// What a device answers to a list of parameters to set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteReply {
    /// See [`return_code`].
    pub return_code: u8,
    /// The key that was refused, 0 where none was.
    pub key: u16,
}

impl WriteReply {
    /// Reads the answer's data.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let [return_code, k0, k1] = *data.first_chunk()?;
        Some(Self { return_code, key: u16::from_le_bytes([k0, k1]) })
    }

    /// The answer's data.
    pub fn to_bytes(self) -> [u8; 3] {
        let [k0, k1] = self.key.to_le_bytes();
        [self.return_code, k0, k1]
    }
}

/// Where a device sends one kind of data, as the value of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostAddress {
    /// Address and port of the host.
    pub host: SocketAddrV4,
    /// Port of the device that it sends from.
    pub device_port: u16,
}

impl HostAddress {
    /// Reads a value.
    pub fn parse(value: &[u8]) -> Option<Self> {
        let [a, b, c, d, h0, h1, d0, d1] = *value.first_chunk()?;
        let host = SocketAddrV4::new(Ipv4Addr::new(a, b, c, d), u16::from_le_bytes([h0, h1]));
        Some(Self { host, device_port: u16::from_le_bytes([d0, d1]) })
    }

    /// The value.
    pub fn to_bytes(self) -> [u8; 8] {
        let ([a, b, c, d], [h0, h1]) = (self.host.ip().octets(), self.host.port().to_le_bytes());
        let [d0, d1] = self.device_port.to_le_bytes();
        [a, b, c, d, h0, h1, d0, d1]
    }
}
