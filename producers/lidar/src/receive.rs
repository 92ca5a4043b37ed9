//! Many packets in one system call, each straight to where it stays, with the time at which the system got it.

use std::io;
use std::mem::size_of;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd};

use rustix::time::{ClockId, clock_gettime};

use crate::store::{Slot, Store};

/// Packets a system call takes at most.
pub(crate) const BATCH: usize = 32;
/// Bytes for a time stamp beside a packet: a header of 16 and two words.
const CONTROL_WORDS: usize = 8;

/// A packet that has come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Received {
    pub(crate) slot: Slot,
    pub(crate) from: SocketAddrV4,
    /// Host monotonic time.
    pub(crate) arrival_ns: i64,
    /// Longer than any packet of a device: cut.
    pub(crate) cut: bool,
}

/// Asks the system to say when each packet came.
pub(crate) fn ask_for_stamps(socket: BorrowedFd<'_>) -> io::Result<()> {
    let on: libc::c_int = 1;
    // SAFETY: the option takes a pointer to an int and its size, which live until the call returns.
    #[allow(unsafe_code)]
    let result = unsafe {
        libc::setsockopt(
            socket.as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_TIMESTAMPNS,
            (&raw const on).cast(),
            size_of::<libc::c_int>() as libc::socklen_t,
        )
    };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Takes what has come, up to [`BATCH`] packets, into free places of the store and adds them to `received`; gives how many. A
/// packet that is not wanted must be given back.
pub(crate) fn receive(
    socket: impl AsFd,
    store: &mut Store,
    received: &mut Vec<Received>,
) -> io::Result<usize> {
    let mut slots = [0; BATCH];
    let mut wanted = 0;
    while wanted < BATCH
        && let Some(slot) = store.take()
    {
        slots[wanted] = slot;
        wanted += 1;
    }
    let got = fill(socket.as_fd(), store, &slots[..wanted], received);
    for slot in slots.get(got.as_ref().map_or(0, |count| *count)..wanted).unwrap_or_default() {
        store.give_back(*slot);
    }
    match got {
        Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(0),
        other => other,
    }
}

fn fill(
    socket: BorrowedFd<'_>,
    store: &mut Store,
    slots: &[Slot],
    received: &mut Vec<Received>,
) -> io::Result<usize> {
    // SAFETY: all-zero bytes are valid values of these C structures.
    #[allow(unsafe_code)]
    let (mut messages, mut pieces, mut senders): (
        [libc::mmsghdr; BATCH],
        [libc::iovec; BATCH],
        [libc::sockaddr_in; BATCH],
    ) = unsafe { std::mem::zeroed() };
    let mut control = [[0_u64; CONTROL_WORDS]; BATCH];
    for (i, slot) in slots.iter().enumerate() {
        let Some(place) = store.place(*slot) else { continue };
        pieces[i] = libc::iovec { iov_base: place.as_mut_ptr().cast(), iov_len: place.len() };
        let header = &mut messages[i].msg_hdr;
        header.msg_iov = &raw mut pieces[i];
        header.msg_iovlen = 1;
        header.msg_name = (&raw mut senders[i]).cast();
        header.msg_namelen = size_of::<libc::sockaddr_in>() as libc::socklen_t;
        header.msg_control = control[i].as_mut_ptr().cast();
        header.msg_controllen = (CONTROL_WORDS * 8) as _;
    }
    // SAFETY: the first `slots.len()` messages point to buffers of the lengths given beside them; they are distinct (a slot is taken
    // once), outlive the call, and are borrowed by nothing else. The call does not block and does not keep the pointers.
    #[allow(unsafe_code)]
    let count = unsafe {
        libc::recvmmsg(
            socket.as_raw_fd(),
            messages.as_mut_ptr(),
            slots.len() as libc::c_uint,
            libc::MSG_DONTWAIT as _,
            std::ptr::null_mut(),
        )
    };
    let count = usize::try_from(count).map_err(|_| io::Error::last_os_error())?;
    let monotonic_from_real = nanoseconds(ClockId::Monotonic) - nanoseconds(ClockId::Realtime);
    for (i, slot) in slots.iter().enumerate().take(count) {
        store.set_length(*slot, messages[i].msg_len as usize);
        let address = Ipv4Addr::from(u32::from_be(senders[i].sin_addr.s_addr));
        let stamp = stamp_of(&control[i], messages[i].msg_hdr.msg_controllen);
        received.push(Received {
            slot: *slot,
            from: SocketAddrV4::new(address, u16::from_be(senders[i].sin_port)),
            arrival_ns: stamp
                .map_or_else(|| nanoseconds(ClockId::Monotonic), |real| real + monotonic_from_real),
            cut: messages[i].msg_hdr.msg_flags & libc::MSG_TRUNC != 0,
        });
    }
    Ok(count)
}

/// The time stamp in what came beside a packet: a header (length, level, type) and seconds with nanoseconds, real time.
/// Only that was asked for, so it is the first and only entry; on other targets than 64-bit Linux it is not looked for.
fn stamp_of(control: &[u64; CONTROL_WORDS], length: usize) -> Option<i64> {
    let [entry, level_and_type, seconds, nanoseconds, ..] = *control;
    let expected = (libc::SCM_TIMESTAMPNS as u64) << 32 | libc::SOL_SOCKET as u64;
    let native = if cfg!(target_endian = "little") { level_and_type } else { level_and_type.rotate_left(32) };
    (cfg!(target_pointer_width = "64") && length >= 32 && entry == 32 && native == expected).then(|| {
        seconds.cast_signed().saturating_mul(1_000_000_000).saturating_add(nanoseconds.cast_signed())
    })
}

/// Now, by one of the system's clocks.
pub(crate) fn nanoseconds(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec)
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;

    use super::*;

    #[test]
    fn packets_come_in_order_with_sender_length_and_the_time_at_which_the_system_got_them() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        ask_for_stamps(socket.as_fd()).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (mut store, mut received) = (Store::new(), Vec::new());
        let free = store.free();
        // The system begins to stamp a little after it was asked to; until then packets bear the time at which they were read.
        let is_stamping = |store: &mut Store| {
            sender.send_to(&[0], socket.local_addr().unwrap()).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(50));
            let (read, mut probe) = (nanoseconds(ClockId::Monotonic), Vec::new());
            receive(&socket, store, &mut probe).unwrap();
            probe.iter().for_each(|packet| store.give_back(packet.slot));
            probe.first().is_some_and(|packet| packet.arrival_ns < read - 10_000_000)
        };
        assert!((0..100).any(|_| is_stamping(&mut store)), "the system never stamps");

        let before = nanoseconds(ClockId::Monotonic);
        for n in 0..40_u8 {
            sender.send_to(&vec![n; usize::from(n) + 1], socket.local_addr().unwrap()).unwrap();
        }
        sender.send_to(&[1; 2000], socket.local_addr().unwrap()).unwrap();
        let sent = nanoseconds(ClockId::Monotonic);
        std::thread::sleep(std::time::Duration::from_millis(50));

        assert_eq!(receive(&socket, &mut store, &mut received).unwrap(), BATCH);
        assert_eq!(receive(&socket, &mut store, &mut received).unwrap(), 41 - BATCH);
        assert_eq!(receive(&socket, &mut store, &mut received).unwrap(), 0);
        assert_eq!(store.free(), free - 41);
        for (n, packet) in received.iter().enumerate().take(40) {
            assert_eq!(store.packet(packet.slot), vec![n as u8; n + 1]);
            assert_eq!(std::net::SocketAddr::V4(packet.from), sender.local_addr().unwrap());
            // The clocks are read one after the other.
            assert!(
                (before - 1_000_000..=sent + 1_000_000).contains(&packet.arrival_ns),
                "{}",
                packet.arrival_ns - sent
            );
            assert!(!packet.cut);
        }
        assert!(received[40].cut);
    }
}
