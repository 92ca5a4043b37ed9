//! What a device says: answers to commands, and messages of its own.

use super::fields::{Extrinsic, Network, ReturnMode, Status, WorkState};

/// The broadcast of a device without a session, once a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Broadcast {
    /// Serial number and a digit, zero padded.
    pub code: [u8; 16],
    /// 0 hub, 1 Mid-40, 2 Tele-15, 3 Horizon, 6 Mid-70, 7 Avia.
    pub device_type: u8,
    /// Always 0.
    pub reserved: u16,
}

impl Broadcast {
    /// The code as text, up to its padding.
    pub fn code_text(&self) -> &str {
        let end = self.code.iter().position(|byte| *byte == 0).unwrap_or(self.code.len());
        self.code.get(..end).and_then(|code| std::str::from_utf8(code).ok()).unwrap_or_default()
    }
}

/// What a device says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reply<'a> {
    /// Message: a device without a session is there.
    Broadcast(Broadcast),
    /// Message: its status.
    Status(Status),
    /// Answer with a return code only, 0 where it was done.
    Done(u8),
    /// Answer to the question for the firmware.
    DeviceInfo {
        /// Return code.
        code: u8,
        /// Version, four numbers.
        firmware: [u8; 4],
    },
    /// Answer to a heartbeat.
    Heartbeat {
        /// Return code.
        code: u8,
        /// What it does; `Err` of a number that is not defined.
        state: Result<WorkState, u8>,
        /// Bit 0: suppresses rain and fog.
        features: u8,
        /// Progress of starting up in percent while it does that, otherwise a [`Status`].
        progress_or_status: u32,
    },
    /// Answer to the question for its address.
    Network {
        /// Return code.
        code: u8,
        /// Address.
        network: Network,
    },
    /// Answer to the question for its extrinsic.
    Extrinsic {
        /// Return code.
        code: u8,
        /// As somebody has told it.
        extrinsic: Extrinsic,
    },
    /// Answer to the question for the return mode.
    ReturnMode {
        /// Return code.
        code: u8,
        /// Which echoes are sent.
        mode: ReturnMode,
    },
    /// Answer to the questions for fan and IMU.
    Switch {
        /// Return code.
        code: u8,
        /// On, or 200 Hz.
        on: bool,
    },
    /// Answer to the setting of a key, and with a value to the question for one.
    Parameter {
        /// Return code.
        code: u8,
        /// The key that was refused, 0 where none was.
        error_key: u16,
        /// Why.
        error: u8,
        /// Key and value.
        entry: Option<(u16, &'a [u8])>,
    },
}

impl<'a> Reply<'a> {
    /// Reads a payload; `None` for one that no device sends.
    pub fn read(set: u8, id: u8, payload: &'a [u8]) -> Option<Self> {
        let (code, rest) = payload.split_first()?;
        let code = *code;
        match (set, id) {
            (0, 0) => {
                let (text, rest) = payload.split_first_chunk::<16>()?;
                let [device_type, r0, r1] = *<&[u8; 3]>::try_from(rest).ok()?;
                let reserved = u16::from_le_bytes([r0, r1]);
                Some(Self::Broadcast(Broadcast { code: *text, device_type, reserved }))
            }
            (0, 2) => Some(Self::DeviceInfo { code, firmware: rest.try_into().ok()? }),
            (0, 3) => {
                let [state, features, p0, p1, p2, p3] = *<&[u8; 6]>::try_from(rest).ok()?;
                let progress_or_status = u32::from_le_bytes([p0, p1, p2, p3]);
                let state = WorkState::from_wire(state).ok_or(state);
                Some(Self::Heartbeat { code, state, features, progress_or_status })
            }
            (0, 7) => Some(Self::Status(Status(u32::from_le_bytes(payload.try_into().ok()?)))),
            (0, 9) => Some(Self::Network { code, network: Network::read(rest)? }),
            (0, 11..=13) => parameter(code, rest),
            (1, 2) => Some(Self::Extrinsic { code, extrinsic: Extrinsic::read(rest)? }),
            (1, 7) => match rest {
                [mode] => Some(Self::ReturnMode { code, mode: ReturnMode::from_wire(*mode)? }),
                _ => None,
            },
            (1, 5 | 9) => match rest {
                [on @ (0 | 1)] => Some(Self::Switch { code, on: *on == 1 }),
                _ => None,
            },
            (0, 1 | 4 | 5 | 6 | 8 | 10) | (1, 0 | 1 | 3 | 4 | 6 | 8 | 10) => {
                rest.is_empty().then_some(Self::Done(code))
            }
            _ => None,
        }
    }

    /// Appends the payload.
    pub fn write(&self, out: &mut Vec<u8>) {
        match *self {
            Self::Broadcast(Broadcast { code, device_type, reserved }) => {
                out.extend_from_slice(&code);
                out.push(device_type);
                out.extend_from_slice(&reserved.to_le_bytes());
            }
            Self::Status(status) => out.extend_from_slice(&status.0.to_le_bytes()),
            Self::Done(code) => out.push(code),
            Self::DeviceInfo { code, firmware } => {
                out.push(code);
                out.extend_from_slice(&firmware);
            }
            Self::Heartbeat { code, state, features, progress_or_status } => {
                out.extend_from_slice(&[code, state.map_or_else(|raw| raw, |state| state as u8), features]);
                out.extend_from_slice(&progress_or_status.to_le_bytes());
            }
            Self::Network { code, network } => {
                out.push(code);
                network.write(out);
            }
            Self::Extrinsic { code, extrinsic } => {
                out.push(code);
                extrinsic.write(out);
            }
            Self::ReturnMode { code, mode } => out.extend_from_slice(&[code, mode as u8]),
            Self::Switch { code, on } => out.extend_from_slice(&[code, u8::from(on)]),
            Self::Parameter { code, error_key, error, entry } => {
                out.push(code);
                out.extend_from_slice(&error_key.to_le_bytes());
                out.push(error);
                if let Some((key, value)) = entry {
                    out.extend_from_slice(&key.to_le_bytes());
                    out.extend_from_slice(&(value.len() as u16).to_le_bytes());
                    out.extend_from_slice(value);
                }
            }
        }
    }
}

fn parameter(code: u8, rest: &[u8]) -> Option<Reply<'_>> {
    let (head, rest) = rest.split_first_chunk::<3>()?;
    let [e0, e1, error] = *head;
    let entry = match rest.split_first_chunk::<4>() {
        Some((&[k0, k1, l0, l1], value)) if value.len() == usize::from(u16::from_le_bytes([l0, l1])) => {
            Some((u16::from_le_bytes([k0, k1]), value))
        }
        None if rest.is_empty() => None,
        _ => return None,
    };
    Some(Reply::Parameter { code, error_key: u16::from_le_bytes([e0, e1]), error, entry })
}
