//! The sockets of one device: bound to the interface's address only.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd as _, OwnedFd};
use std::time::Duration;

use evac_stage::StageError;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};

use crate::receive::ask_for_stamps;
use crate::session::Channel;
use crate::{Config, Protocol};

/// Port on which hosts listen for broadcasts of the first protocol.
const BROADCAST_PORT: u16 = 55000;

/// Sockets in use.
#[derive(Debug)]
pub(crate) struct Sockets {
    /// Commands and their answers.
    command: UdpSocket,
    /// Broadcasts, or searches and their answers.
    search: UdpSocket,
    /// Broadcasts to 255.255.255.255, which a socket bound to one address does not get.
    broadcast: Option<UdpSocket>,
    /// Points and IMU samples.
    pub(crate) data: UdpSocket,
    command_port: u16,
    data_port: u16,
}

impl Sockets {
    pub(crate) fn open(config: &Config) -> Result<Self, StageError> {
        let at = |port| SocketAddrV4::new(config.interface, port);
        let search_port = match config.protocol {
            Protocol::Sdk1 => BROADCAST_PORT,
            Protocol::Sdk2 => evac_formats::livox_sdk2::ports::SEARCH,
        };
        let search = open(at(search_port), true)?;
        let broadcast = (!config.interface.is_loopback())
            .then(|| open(SocketAddrV4::new(Ipv4Addr::BROADCAST, search_port), true))
            .transpose()?;
        search.set_broadcast(true).map_err(|cause| refused(at(search_port), &cause))?;
        let command = open(at(config.command_port), false)?;
        let data = open(at(config.data_port), false)?;
        let bytes = config.receive_buffer_mib as usize * 1024 * 1024;
        sockopt::set_socket_recv_buffer_size(&data, bytes)
            .map_err(|cause| refused(at(config.data_port), &cause.into()))?;
        ask_for_stamps(data.as_fd()).map_err(|cause| refused(at(config.data_port), &cause))?;
        let (command_port, data_port) = (port(&command), port(&data));
        Ok(Self { command, search, broadcast, data, command_port, data_port })
    }

    pub(crate) fn command_port(&self) -> u16 {
        self.command_port
    }

    pub(crate) fn data_port(&self) -> u16 {
        self.data_port
    }

    /// Bytes of the data socket's buffer that the system gave (it doubles what it is asked for, for its own needs).
    pub(crate) fn receive_buffer(&self) -> usize {
        sockopt::socket_recv_buffer_size(&self.data).unwrap_or(0)
    }

    pub(crate) fn send(&self, channel: Channel, to: SocketAddrV4, bytes: &[u8]) -> io::Result<()> {
        let socket = match channel {
            Channel::Command => &self.command,
            Channel::Search => &self.search,
        };
        socket.send_to(bytes, to).map(|_| ())
    }

    /// Waits until something has come, or for `patience`; whether data has come.
    pub(crate) fn wait(&self, patience: Duration, with_data: bool) -> bool {
        let sockets = [Some(&self.command), Some(&self.search), self.broadcast.as_ref(), Some(&self.data)];
        // The data's is the last.
        let until = if with_data { 4 } else { 3 };
        let mut waiting: [PollFd<'_>; 4] =
            sockets.map(|socket| PollFd::new(socket.unwrap_or(&self.command), PollFlags::IN));
        let patience =
            Timespec { tv_sec: patience.as_secs().cast_signed(), tv_nsec: patience.subsec_nanos().into() };
        // An interruption is looked at like a time-out: the caller comes back.
        let _ = poll(waiting.get_mut(..until).unwrap_or_default(), Some(&patience));
        waiting[3].revents().contains(PollFlags::IN)
    }

    /// A control datagram that has come, with its sender.
    pub(crate) fn receive<'a>(&self, buffer: &'a mut [u8]) -> Option<(SocketAddrV4, &'a [u8])> {
        for socket in [Some(&self.command), Some(&self.search), self.broadcast.as_ref()].into_iter().flatten()
        {
            // An error is of an earlier sending (nobody listens there): the session's time-outs see to it.
            if let Ok((length, SocketAddr::V4(from))) = socket.recv_from(buffer) {
                return Some((from, buffer.get(..length).unwrap_or_default()));
            }
        }
        None
    }
}

fn port(socket: &UdpSocket) -> u16 {
    socket.local_addr().map_or(0, |address| address.port())
}

fn open(address: SocketAddrV4, shared: bool) -> Result<UdpSocket, StageError> {
    let bound = || -> io::Result<OwnedFd> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, flags, None)?;
        if shared {
            // Drivers of several devices listen for broadcasts side by side.
            sockopt::set_socket_reuseaddr(&socket, true)?;
        }
        bind(&socket, &SocketAddr::V4(address))?;
        Ok(socket)
    };
    bound().map(UdpSocket::from).map_err(|cause| refused(address, &cause))
}

fn refused(address: SocketAddrV4, cause: &io::Error) -> StageError {
    let remedy = match cause.kind() {
        io::ErrorKind::AddrNotAvailable => {
            "set interface to an address that this computer has on the LiDAR's network (`ip -4 addr`)"
        }
        io::ErrorKind::AddrInUse => {
            "another program listens there: end it (`ss -lunp`), or choose another port"
        }
        _ => "check the network and its permissions",
    };
    StageError::File(format!("UDP {address}: {cause}; {remedy}"))
}
