//! The same frame over a Unix stream socket as most programs send one: structures serialised with serde and postcard.

use std::io::{ErrorKind, Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use anyhow::Context as _;
use evac_frames::{FrameHeader, Point};
use evac_ports::now_ns;
use serde::{Deserialize, Serialize};

use crate::case::{Case, Link, RoundTrip};
use crate::peer::{Job, Peer, say_ready};

/// A peer that is silent for this long is broken.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest form of a point: three floats, and a varint of 32 bits.
const LONGEST_POINT: usize = 3 * size_of::<f32>() + 5;
const LONGEST_HEAD: usize = 64;

/// A message: times, and the points.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Message {
    arrival_ns: i64,
    sent_ns: i64,
    points: Vec<WirePoint>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct WirePoint {
    x: f32,
    y: f32,
    z: f32,
    packed: u32,
}

impl From<Point> for WirePoint {
    fn from(Point { x, y, z, packed }: Point) -> Self {
        Self { x, y, z, packed }
    }
}

impl From<&WirePoint> for Point {
    fn from(WirePoint { x, y, z, packed }: &WirePoint) -> Self {
        Self { x: *x, y: *y, z: *z, packed: *packed }
    }
}

/// Connects to a new peer.
///
/// # Errors
/// The peer does not start.
pub(crate) fn connect(case: &Case) -> anyhow::Result<Box<dyn Link>> {
    let (ours, theirs) = UnixStream::pair()?;
    ours.set_read_timeout(Some(PATIENCE))?;
    let peer = Peer::start(Job::Postcard, case, "", OwnedFd::from(theirs))?;
    Ok(Box::new(Postcard { wire: Wire::new(ours, case), expected_sum: case.expected_sum(), _peer: peer }))
}

/// Answers every frame until the other end is closed.
///
/// # Errors
/// The socket fails, or something else came than was sent.
pub(crate) fn serve(case: &Case) -> anyhow::Result<()> {
    let mut wire = Wire::new(UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?), case);
    let expected_sum = case.expected_sum();
    say_ready()?;
    while let Some(message) = wire.receive()? {
        let arrival_ns = now_ns();
        read(case, &message, expected_sum)?;
        wire.send(arrival_ns)?;
    }
    Ok(())
}

struct Postcard {
    wire: Wire,
    expected_sum: u64,
    _peer: Peer,
}

impl Link for Postcard {
    fn round_trips(&mut self, count: u64, record: &mut dyn FnMut(i64)) -> anyhow::Result<()> {
        let case = self.wire.case;
        for _ in 0..count {
            let start_ns = now_ns();
            let sent_ns = self.wire.send(start_ns)?;
            let answer = self.wire.receive()?.context("the peer does not answer")?;
            let trip = RoundTrip { start_ns, sent_ns, received_ns: now_ns() };
            read(&case, &answer, self.expected_sum)?;
            let header = FrameHeader {
                arrival_ns: answer.arrival_ns,
                sent_ns: answer.sent_ns,
                ..FrameHeader::default()
            };
            record(trip.one_way_ns(case.measure, &header));
        }
        Ok(())
    }
}

fn read(case: &Case, message: &Message, expected_sum: u64) -> anyhow::Result<()> {
    let points: Vec<Point> =
        if case.is_read() { message.points.iter().map(Point::from).collect() } else { Vec::new() };
    anyhow::ensure!(
        message.points.len() == case.points,
        "{} of {} points came",
        message.points.len(),
        case.points
    );
    if case.is_read() { case.read(&points, expected_sum) } else { Ok(()) }
}

/// One end: a length of four bytes, and the message.
struct Wire {
    stream: UnixStream,
    outgoing: Message,
    bytes: Vec<u8>,
    case: Case,
}

impl Wire {
    fn new(stream: UnixStream, case: &Case) -> Self {
        let points = (0..case.points).map(|index| case.point(index).into()).collect();
        let outgoing = Message { points, ..Message::default() };
        Self { stream, outgoing, bytes: vec![0; LONGEST_HEAD + case.points * LONGEST_POINT], case: *case }
    }

    /// Writes a frame and sends it; returns when its serialising began.
    fn send(&mut self, arrival_ns: i64) -> anyhow::Result<i64> {
        if self.case.is_read() {
            for (index, point) in self.outgoing.points.iter_mut().enumerate() {
                *point = self.case.point(index).into();
            }
        }
        (self.outgoing.arrival_ns, self.outgoing.sent_ns) = (arrival_ns, now_ns());
        let body = self.bytes.get_mut(4..).unwrap_or_default();
        let len = postcard::to_slice(&self.outgoing, body)?.len();
        self.bytes[..4].copy_from_slice(&u32::try_from(len)?.to_le_bytes());
        self.stream.write_all(&self.bytes[..4 + len])?;
        Ok(self.outgoing.sent_ns)
    }

    /// The next message; none when the other end is closed.
    fn receive(&mut self) -> anyhow::Result<Option<Message>> {
        let mut len = [0; 4];
        match self.stream.read_exact(&mut len) {
            Err(cause) if cause.kind() == ErrorKind::UnexpectedEof => return Ok(None),
            result => result?,
        }
        let body = self.bytes.get_mut(..u32::from_le_bytes(len) as usize).context("a message is too long")?;
        self.stream.read_exact(body)?;
        Ok(Some(postcard::from_bytes(body)?))
    }
}
