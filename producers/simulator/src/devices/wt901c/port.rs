//! The module on a pseudo-terminal.

use std::io;
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

use super::module::Module;
use crate::random::Random;

/// Stream of random numbers for faults of the line.
const LINE: u64 = 0x1157;

/// What goes wrong on the line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// Share of bytes with a flipped bit.
    pub corrupt_share: f64,
    /// Share of bytes that get lost.
    pub drop_share: f64,
    /// Bytes of rubbish before each sample.
    pub garbage_bytes: usize,
    /// Nothing is sent.
    pub silent: bool,
}

/// A [`Module`] on a pseudo-terminal that a link names. Unplugging it removes both; plugging it in again makes a new terminal
/// under the same link, as a USB adapter's path by id does.
#[derive(Debug)]
pub struct Port {
    /// The module; what is done to it takes effect at once.
    pub module: Module,
    /// The line's faults.
    pub faults: Faults,
    link: PathBuf,
    master: Option<OwnedFd>,
    random: Random,
    out: Vec<u8>,
}

impl Port {
    /// Plugs the module in: `link` then names its terminal.
    ///
    /// # Errors
    /// Where no terminal or no link can be made.
    pub fn open(link: &Path, module: Module, seed: u64) -> io::Result<Self> {
        let mut port = Self {
            module,
            faults: Faults::default(),
            link: link.to_owned(),
            master: None,
            random: Random::new(seed, LINE),
            out: Vec::with_capacity(4096),
        };
        port.plug_in()?;
        Ok(port)
    }

    /// A cable that is pulled: the terminal hangs up and its link is gone.
    pub fn unplug(&mut self) {
        self.master = None;
        // Not being there is what is wanted.
        let _ = std::fs::remove_file(&self.link);
    }

    /// Whether the cable is in.
    pub fn is_plugged_in(&self) -> bool {
        self.master.is_some()
    }

    /// The cable is in again, and the module has had no power meanwhile.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn plug_in(&mut self) -> io::Result<()> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        rustix::io::ioctl_fionbio(&master, true)?;
        // Before anybody opens it: a terminal would echo what the module sends back to it.
        let mut settings = tcgetattr(&master)?;
        settings.make_raw();
        tcsetattr(&master, OptionalActions::Now, &settings)?;
        let slave = PathBuf::from(std::ffi::OsString::from_vec(ptsname(&master, Vec::new())?.into_bytes()));
        let part = self.link.with_extension(format!("{}.part", std::process::id()));
        std::os::unix::fs::symlink(slave, &part)?;
        std::fs::rename(part, &self.link)?;
        self.master = Some(master);
        self.module.power_cycle();
        Ok(())
    }

    /// A measurement at `now_ns` of the host's monotonic clock. Call it 200 times a second, in time: it also does what the host
    /// has asked for meanwhile.
    ///
    /// # Errors
    /// What the terminal refuses, but for a host that is not there.
    pub fn feed(&mut self, now_ns: i64, accel: [i16; 3], gyro: [i16; 3]) -> io::Result<()> {
        self.listen(now_ns)?;
        self.out.clear();
        self.module.measure(now_ns, accel, gyro, &mut self.out);
        if self.faults.garbage_bytes > 0 {
            let garbage: Vec<u8> =
                (0..self.faults.garbage_bytes).map(|_| (self.random.uniform() * 256.0) as u8).collect();
            self.out.splice(0..0, garbage);
        }
        self.send()
    }

    /// Hears what the host has said, and answers.
    ///
    /// # Errors
    /// As [`Self::feed`].
    pub fn listen(&mut self, now_ns: i64) -> io::Result<()> {
        let mut buffer = [0; 256];
        while let Some(master) = &self.master {
            let read = match rustix::io::read(master, &mut buffer) {
                Ok(0) => break,
                Ok(read) => read,
                Err(cause) if is_absence(cause) => break,
                Err(cause) => return Err(cause.into()),
            };
            // At another speed it hears nothing that makes sense.
            if self.host_baud()? == self.module.baud() {
                self.out.clear();
                for byte in buffer.iter().take(read) {
                    self.module.hear(*byte, now_ns, &mut self.out);
                }
                self.send()?;
            }
        }
        Ok(())
    }

    /// Speed that the host has set.
    fn host_baud(&self) -> io::Result<u32> {
        self.master.as_ref().map_or(Ok(0), |master| Ok(tcgetattr(master)?.output_speed()))
    }

    fn send(&mut self) -> io::Result<()> {
        if self.faults.silent || self.out.is_empty() {
            return Ok(());
        }
        self.spoil()?;
        let Some(master) = &self.master else { return Ok(()) };
        if !somebody_listens(master)? {
            // On a line without a host bytes are gone, they do not pile up.
            return tcflush(master, QueueSelector::OFlush).map_err(io::Error::from);
        }
        match rustix::io::write(master, &self.out) {
            Ok(_) => Ok(()),
            Err(cause) if is_absence(cause) => Ok(()),
            Err(cause) => Err(cause.into()),
        }
    }

    /// What comes out at the other end of the line.
    fn spoil(&mut self) -> io::Result<()> {
        let (host, own) = (self.host_baud()?, self.module.baud());
        if host != own {
            // Bits sampled at the wrong moments: rubbish, as many bytes as the host has time for.
            let bytes = (self.out.len() as f64 * f64::from(host) / f64::from(own)).clamp(1.0, 512.0) as usize;
            self.out.clear();
            self.out.extend((0..bytes).map(|_| (self.random.uniform() * 256.0) as u8 | 0x80));
            return Ok(());
        }
        let Faults { corrupt_share, drop_share, .. } = self.faults;
        if corrupt_share > 0.0 || drop_share > 0.0 {
            let random = &mut self.random;
            self.out.retain(|_| random.uniform() >= drop_share);
            for byte in &mut self.out {
                if random.uniform() < corrupt_share {
                    *byte ^= 1 << (random.uniform() * 8.0) as u32;
                }
            }
        }
        Ok(())
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.unplug();
    }
}

/// Whether a host has the terminal open.
fn somebody_listens(master: &OwnedFd) -> io::Result<bool> {
    let mut ports = [PollFd::from_borrowed_fd(master.as_fd(), PollFlags::OUT)];
    poll(&mut ports, Some(&Timespec::default()))?;
    Ok(!ports[0].revents().contains(PollFlags::HUP))
}

/// Nobody has it open (EIO), or there is nothing to read, or no room.
fn is_absence(cause: rustix::io::Errno) -> bool {
    use rustix::io::Errno;
    [Errno::IO, Errno::AGAIN, Errno::INTR].contains(&cause)
}
