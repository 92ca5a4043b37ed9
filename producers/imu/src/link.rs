//! The serial port: found, opened for this process alone, read, lost and found again.

use std::io::{ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serialport::{ClearBuffer, SerialPort as _, TTYPort};

use crate::Config;

/// Where udev names serial adapters by what they say they are.
const BY_ID: &str = "/dev/serial/by-id";

/// An open port.
#[derive(Debug)]
pub(crate) struct Link {
    port: TTYPort,
    /// Latency timer of an FTDI adapter, milliseconds.
    pub(crate) latency_timer_ms: Option<u32>,
}

/// What reading gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Heard {
    Bytes(usize),
    Nothing,
    /// The port is gone.
    Gone,
}

impl Link {
    /// Opens the configured port.
    pub(crate) fn open(config: &Config) -> Result<Self, String> {
        let path = match &config.usb_id {
            None => config.port.clone(),
            Some(part) => by_id(Path::new(BY_ID), part)
                .ok_or_else(|| format!("no adapter whose name in {BY_ID} contains '{part}'"))?,
        };
        // The port of a mere link is its target: that is what has a latency timer.
        let device = std::fs::canonicalize(&path)
            .map_err(|cause| format!("{}: {cause}; is it plugged in?", path.display()))?;
        let port = serialport::new(device.to_string_lossy(), config.baud)
            .timeout(Duration::from_millis(100))
            .open_native()
            .map_err(|cause| refusal(&path, &std::io::Error::from(cause)))?;
        Ok(Self { port, latency_timer_ms: latency_timer_ms(&device) })
    }

    /// Waits up to `patience` for bytes.
    pub(crate) fn read(&mut self, buffer: &mut [u8], patience: Duration) -> Heard {
        if self.port.set_timeout(patience).is_err() {
            return Heard::Gone;
        }
        match self.port.read(buffer) {
            // A terminal whose other end has hung up reads as ended.
            Ok(0) => Heard::Gone,
            Ok(bytes) => Heard::Bytes(bytes),
            Err(cause) if [ErrorKind::TimedOut, ErrorKind::Interrupted].contains(&cause.kind()) => {
                Heard::Nothing
            }
            Err(_) => Heard::Gone,
        }
    }

    /// Sends a command; `false` where the port is gone.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> bool {
        self.port.write_all(bytes).is_ok()
    }

    /// Sets the line's speed and forgets what has come in; `false` where the port is gone.
    pub(crate) fn set_baud(&mut self, baud: u32) -> bool {
        self.port.set_baud_rate(baud).is_ok() && self.port.clear(ClearBuffer::Input).is_ok()
    }
}

fn refusal(path: &Path, cause: &std::io::Error) -> String {
    let remedy = match cause.kind() {
        ErrorKind::PermissionDenied => "join the group dialout, see evac doctor",
        _ => "in use? see evac doctor",
    };
    format!("{}: {cause}; {remedy}", path.display())
}

/// The port in `folder` (normally `/dev/serial/by-id`) whose name contains `part`; of several the first by name.
fn by_id(folder: &Path, part: &str) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    entries.map(|entry| entry.path()).filter(|path| path.to_string_lossy().contains(part)).min()
}

/// Latency timer of a USB adapter that has one (FTDI), milliseconds: so long it keeps bytes back.
fn latency_timer_ms(device: &Path) -> Option<u32> {
    let name = device.file_name()?;
    let path = Path::new("/sys/bus/usb-serial/devices").join(name).join("latency_timer");
    std::fs::read_to_string(path).ok()?.trim().parse().ok()
}
