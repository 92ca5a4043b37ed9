//! What a host asks of a device: the payloads of commands.

use super::fields::{Extrinsic, Network, ReturnMode, UtcTime};

/// A command with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request<'a> {
    /// Begins a session: where the device shall send.
    Handshake {
        /// Address of the host.
        host: [u8; 4],
        /// Port of the host for points.
        data_port: u16,
        /// Port of the host for answers.
        command_port: u16,
        /// Port of the host for IMU samples; early firmware has none.
        imu_port: Option<u16>,
    },
    /// Firmware version.
    DeviceInfo,
    /// Keeps the session alive; asked for at least once a second.
    Heartbeat,
    /// Starts or stops measuring.
    Sampling(bool),
    /// Cartesian or spherical points.
    Coordinates {
        /// Spherical.
        spherical: bool,
    },
    /// Ends the session.
    Disconnect,
    /// Sets the device's own address.
    SetNetwork(Network),
    /// Asks for the device's own address.
    GetNetwork,
    /// Restarts after so many milliseconds.
    Reboot(u16),
    /// Sets one key.
    WriteParameter {
        /// 1 high sensitivity, 2 scan pattern, 3 slot.
        key: u16,
        /// Its value.
        value: &'a [u8],
    },
    /// Asks for one key.
    ReadParameter(u16),
    /// 1 normal, 2 power saving, 3 standby.
    SetMode(u8),
    /// Sets where the device sits; it only remembers it.
    WriteExtrinsic(Extrinsic),
    /// Asks where the device sits.
    ReadExtrinsic,
    /// Suppression of rain and fog (Mid-40).
    RainFog(bool),
    /// Fan (Tele-15, Horizon).
    SetFan(bool),
    /// Asks for the fan.
    GetFan,
    /// Which echoes are sent (not Mid-40).
    SetReturnMode(ReturnMode),
    /// Asks for the return mode.
    GetReturnMode,
    /// IMU samples at 200 Hz or none (not Mid-40).
    SetImu(bool),
    /// Asks whether IMU samples are sent.
    GetImu,
    /// Time of the last pulse.
    UtcTime(UtcTime),
}

impl<'a> Request<'a> {
    /// Command set and command.
    pub fn code(&self) -> (u8, u8) {
        match self {
            Self::Handshake { .. } => (0, 1),
            Self::DeviceInfo => (0, 2),
            Self::Heartbeat => (0, 3),
            Self::Sampling(_) => (0, 4),
            Self::Coordinates { .. } => (0, 5),
            Self::Disconnect => (0, 6),
            Self::SetNetwork(_) => (0, 8),
            Self::GetNetwork => (0, 9),
            Self::Reboot(_) => (0, 10),
            Self::WriteParameter { .. } => (0, 11),
            Self::ReadParameter(_) => (0, 12),
            Self::SetMode(_) => (1, 0),
            Self::WriteExtrinsic(_) => (1, 1),
            Self::ReadExtrinsic => (1, 2),
            Self::RainFog(_) => (1, 3),
            Self::SetFan(_) => (1, 4),
            Self::GetFan => (1, 5),
            Self::SetReturnMode(_) => (1, 6),
            Self::GetReturnMode => (1, 7),
            Self::SetImu(_) => (1, 8),
            Self::GetImu => (1, 9),
            Self::UtcTime(_) => (1, 10),
        }
    }

    /// Appends the payload.
    pub fn write(&self, out: &mut Vec<u8>) {
        match *self {
            Self::Handshake { host, data_port, command_port, imu_port } => {
                out.extend_from_slice(&host);
                for port in [Some(data_port), Some(command_port), imu_port].into_iter().flatten() {
                    out.extend_from_slice(&port.to_le_bytes());
                }
            }
            Self::Sampling(on)
            | Self::Coordinates { spherical: on }
            | Self::RainFog(on)
            | Self::SetFan(on)
            | Self::SetImu(on) => out.push(u8::from(on)),
            Self::SetMode(mode) => out.push(mode),
            Self::SetReturnMode(mode) => out.push(mode as u8),
            Self::SetNetwork(network) => network.write(out),
            Self::Reboot(milliseconds) => out.extend_from_slice(&milliseconds.to_le_bytes()),
            Self::WriteParameter { key, value } => {
                out.extend_from_slice(&key.to_le_bytes());
                out.extend_from_slice(&(value.len() as u16).to_le_bytes());
                out.extend_from_slice(value);
            }
            Self::ReadParameter(key) => {
                out.push(1);
                out.extend_from_slice(&key.to_le_bytes());
            }
            Self::WriteExtrinsic(extrinsic) => extrinsic.write(out),
            Self::UtcTime(time) => out.extend_from_slice(&time.to_bytes()),
            Self::DeviceInfo
            | Self::Heartbeat
            | Self::Disconnect
            | Self::GetNetwork
            | Self::ReadExtrinsic
            | Self::GetFan
            | Self::GetReturnMode
            | Self::GetImu => {}
        }
    }

    /// Reads a payload; `None` for a command that is not one of these, or of another length.
    pub fn read(set: u8, id: u8, payload: &'a [u8]) -> Option<Self> {
        let flag = || match payload {
            [value @ (0 | 1)] => Some(*value == 1),
            _ => None,
        };
        let empty = |request| payload.is_empty().then_some(request);
        match (set, id) {
            (0, 1) => handshake(payload),
            (0, 2) => empty(Self::DeviceInfo),
            (0, 3) => empty(Self::Heartbeat),
            (0, 4) => flag().map(Self::Sampling),
            (0, 5) => flag().map(|spherical| Self::Coordinates { spherical }),
            (0, 6) => empty(Self::Disconnect),
            (0, 8) => Network::read(payload).map(Self::SetNetwork),
            (0, 9) => empty(Self::GetNetwork),
            (0, 10) => Some(Self::Reboot(u16::from_le_bytes(payload.try_into().ok()?))),
            (0, 11) => {
                let (head, value) = payload.split_first_chunk::<4>()?;
                let [k0, k1, l0, l1] = *head;
                (value.len() == usize::from(u16::from_le_bytes([l0, l1])))
                    .then_some(Self::WriteParameter { key: u16::from_le_bytes([k0, k1]), value })
            }
            (0, 12) => match payload {
                [1, k0, k1] => Some(Self::ReadParameter(u16::from_le_bytes([*k0, *k1]))),
                _ => None,
            },
            (1, 0) => match payload {
                [mode] => Some(Self::SetMode(*mode)),
                _ => None,
            },
            (1, 1) => Extrinsic::read(payload).map(Self::WriteExtrinsic),
            (1, 2) => empty(Self::ReadExtrinsic),
            (1, 3) => flag().map(Self::RainFog),
            (1, 4) => flag().map(Self::SetFan),
            (1, 5) => empty(Self::GetFan),
            (1, 6) => match payload {
                [mode] => ReturnMode::from_wire(*mode).map(Self::SetReturnMode),
                _ => None,
            },
            (1, 7) => empty(Self::GetReturnMode),
            (1, 8) => flag().map(Self::SetImu),
            (1, 9) => empty(Self::GetImu),
            (1, 10) => Some(Self::UtcTime(UtcTime::from_bytes(payload.try_into().ok()?))),
            _ => None,
        }
    }
}

fn handshake<'a>(payload: &[u8]) -> Option<Request<'a>> {
    let (head, rest) = payload.split_first_chunk::<8>()?;
    let [a, b, c, d, d0, d1, c0, c1] = *head;
    let imu_port = match rest {
        [] => None,
        [i0, i1] => Some(u16::from_le_bytes([*i0, *i1])),
        _ => return None,
    };
    Some(Request::Handshake {
        host: [a, b, c, d],
        data_port: u16::from_le_bytes([d0, d1]),
        command_port: u16::from_le_bytes([c0, c1]),
        imu_port,
    })
}
