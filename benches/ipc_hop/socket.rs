//! The same bytes over a Unix stream socket.

use std::io::{ErrorKind, Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use anyhow::Context as _;
use evac_frames::{FrameHeader, Point, ScanHeader};
use evac_ports::now_ns;

use crate::case::{Case, Link, Measure, RoundTrip};
use crate::peer::{Job, Peer, say_ready};

/// A peer that is silent for this long is broken.
const PATIENCE: Duration = Duration::from_secs(10);

/// Points that the header takes at the front of a message.
const HEADER_POINTS: usize = size_of::<ScanHeader>().div_ceil(size_of::<Point>());

/// Connects to a new peer.
///
/// # Errors
/// The peer does not start.
pub(crate) fn connect(case: &Case) -> anyhow::Result<Box<dyn Link>> {
    let (ours, theirs) = UnixStream::pair()?;
    ours.set_read_timeout(Some(PATIENCE))?;
    let peer = Peer::start(Job::Socket, case, "", OwnedFd::from(theirs))?;
    let expected_sum = case.expected_sum();
    let wire = Wire { stream: ours, outgoing: message(case), incoming: message(case), case: *case };
    Ok(Box::new(Socket { wire, expected_sum, _peer: peer }))
}

/// Answers every frame until the other end is closed.
///
/// # Errors
/// The socket fails, or something else came than was sent.
pub(crate) fn serve(case: &Case) -> anyhow::Result<()> {
    let stream = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    let mut wire = Wire { stream, outgoing: message(case), incoming: message(case), case: *case };
    let expected_sum = case.expected_sum();
    say_ready()?;
    loop {
        match wire.receive() {
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(error.into()),
        }
        let arrival_ns = now_ns();
        case.read(wire.points(), expected_sum)?;
        wire.send(arrival_ns)?;
    }
}

struct Socket {
    wire: Wire,
    expected_sum: u64,
    _peer: Peer,
}

impl Link for Socket {
    fn round_trips(&mut self, count: u64, record: &mut dyn FnMut(i64)) -> anyhow::Result<()> {
        let case = self.wire.case;
        for _ in 0..count {
            let start_ns = now_ns();
            let sent_ns = self.wire.send(start_ns)?;
            let answer = self.wire.receive().context("the peer does not answer")?;
            let trip = RoundTrip { start_ns, sent_ns, received_ns: now_ns() };
            case.read(self.wire.points(), self.expected_sum)?;
            record(trip.one_way_ns(case.measure, &answer));
        }
        Ok(())
    }
}

/// One end: a message is a header and its points, in one buffer so that it takes one system call.
struct Wire {
    stream: UnixStream,
    outgoing: Vec<Point>,
    incoming: Vec<Point>,
    case: Case,
}

fn message(case: &Case) -> Vec<Point> {
    let mut message = vec![Point::default(); HEADER_POINTS];
    message.extend((0..case.points).map(|index| case.point(index)));
    message
}

impl Wire {
    /// Writes a frame into the buffer and sends it; returns when that began.
    fn send(&mut self, arrival_ns: i64) -> std::io::Result<i64> {
        let (head, points) = self.outgoing.split_at_mut(HEADER_POINTS);
        if self.case.measure == Measure::WriteAndSum {
            for (index, point) in points.iter_mut().enumerate() {
                *point = self.case.point(index);
            }
        }
        let sent_ns = now_ns();
        let frame = FrameHeader { arrival_ns, sent_ns, ..FrameHeader::default() };
        let header = ScanHeader { frame, points: self.case.points as u32, ..ScanHeader::default() };
        bytemuck::cast_slice_mut(head)[..size_of::<ScanHeader>()]
            .copy_from_slice(bytemuck::bytes_of(&header));
        self.stream.write_all(bytemuck::cast_slice(&self.outgoing))?;
        Ok(sent_ns)
    }

    fn receive(&mut self) -> std::io::Result<FrameHeader> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut self.incoming);
        self.stream.read_exact(bytes)?;
        let header: ScanHeader = bytemuck::pod_read_unaligned(&bytes[..size_of::<ScanHeader>()]);
        Ok(header.frame)
    }

    /// Points of the last frame that came.
    fn points(&self) -> &[Point] {
        &self.incoming[HEADER_POINTS..]
    }
}
