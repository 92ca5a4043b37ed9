//! The hop as the stages make it: a slice written into loaned memory, and a blocking wake-up.

use std::ops::ControlFlow;
use std::process::Stdio;
use std::time::Duration;

use anyhow::anyhow;
use evac_frames::{FrameHeader, Point, ScanHeader};
use evac_ports::services::{FrameService, LidarScan, MapSnapshot, Qos, SliceLen};
use evac_ports::{
    Bus, Domain, FramePublisher, FrameSubscriber, Listener, PortError, Wake, now_ns, quiet_middleware,
    wait_on,
};

use crate::case::{Case, Link, RoundTrip};
use crate::peer::{Job, Peer, say_ready};

/// A peer that is silent for this long is broken.
const PATIENCE_NS: i64 = 10_000_000_000;
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// One direction: a service with the numbers of `lidar/scan`, or of `map/snapshot` where the frame is too large for that.
#[derive(Debug)]
pub(crate) struct Direction<const LARGE: bool, const BACK: bool>;

impl<const LARGE: bool, const BACK: bool> FrameService for Direction<LARGE, BACK> {
    const NAME: &'static str = match (LARGE, BACK) {
        (false, false) => "bench/scan",
        (false, true) => "bench/scan/answer",
        (true, false) => "bench/large",
        (true, true) => "bench/large/answer",
    };
    const QOS: Qos = if LARGE { MapSnapshot::QOS } else { LidarScan::QOS };
    const LEN: SliceLen = if LARGE { SliceLen::Fixed(Case::MAX_POINTS) } else { LidarScan::LEN };
    type Header = ScanHeader;
    type Item = Point;
}

/// Whether a case's frame is too large for `lidar/scan`.
pub(crate) fn is_large(case: &Case) -> bool {
    matches!(LidarScan::LEN, SliceLen::Fixed(most) if case.points > most)
}

/// How this side waits for the answer. The peer waits as the stages do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WakeUp {
    /// A wait set over several services: the stages' way.
    WaitSet,
    /// One service's listener.
    Listener,
    /// Looks without a pause; takes a whole core.
    Spin,
}

/// Connects to a new peer, and to others that receive the same frames and do not answer.
///
/// # Errors
/// The services cannot be opened or a peer does not start.
pub(crate) fn connect(
    bus: &Bus,
    domain: &Domain,
    case: &Case,
    wake_up: WakeUp,
    readers: usize,
) -> anyhow::Result<Box<dyn Link>> {
    if is_large(case) {
        Ok(Box::new(SharedMemory::<true>::connect(bus, domain, case, wake_up, readers)?))
    } else {
        Ok(Box::new(SharedMemory::<false>::connect(bus, domain, case, wake_up, readers)?))
    }
}

/// Receives every frame, and answers it where it `answers`, until SIGTERM comes.
///
/// # Errors
/// The services cannot be used, or something else came than was sent.
pub(crate) fn serve<const LARGE: bool>(case: &Case, domain: &str, answers_them: bool) -> anyhow::Result<()> {
    quiet_middleware(true);
    let bus = Bus::join(&Domain::new(domain)?, "bench-peer")?;
    let (frames, listener) = FrameSubscriber::<Direction<LARGE, false>>::open(&bus)?;
    let answers = FramePublisher::<Direction<LARGE, true>>::open(&bus)?;
    let expected_sum = case.expected_sum();
    say_ready()?;
    let answer_all = || -> anyhow::Result<()> {
        while let Some(frame) = frames.receive()? {
            let arrival_ns = now_ns();
            case.read(frame.items(), expected_sum)?;
            drop(frame);
            if answers_them {
                publish(&answers, case, arrival_ns)?;
            }
        }
        Ok(())
    };
    wait_on(&[listener], |wake| match (wake, answer_all()) {
        (_, Err(error)) => ControlFlow::Break(Err(error)),
        (Wake::Stop, Ok(())) => ControlFlow::Break(Ok(())),
        (Wake::Look, Ok(())) => ControlFlow::Continue(LOOK_AGAIN),
    })?
}

struct SharedMemory<const LARGE: bool> {
    frames: FramePublisher<Direction<LARGE, false>>,
    answers: FrameSubscriber<Direction<LARGE, true>>,
    listeners: [Listener; 1],
    case: Case,
    expected_sum: u64,
    wake_up: WakeUp,
    _peers: Vec<Peer>,
}

impl<const LARGE: bool> SharedMemory<LARGE> {
    fn connect(
        bus: &Bus,
        domain: &Domain,
        case: &Case,
        wake_up: WakeUp,
        readers: usize,
    ) -> anyhow::Result<Self> {
        let (answers, listener) = FrameSubscriber::open(bus)?;
        let jobs = std::iter::once(Job::SharedMemory).chain(std::iter::repeat_n(Job::Listen, readers - 1));
        let peers = jobs.map(|job| Peer::start(job, case, domain.name(), Stdio::null()));
        Ok(Self {
            frames: FramePublisher::open(bus)?,
            answers,
            listeners: [listener],
            case: *case,
            expected_sum: case.expected_sum(),
            wake_up,
            _peers: peers.collect::<Result<_, _>>()?,
        })
    }

    fn send(&self) -> Result<RoundTrip, PortError> {
        let start_ns = now_ns();
        let sent_ns = publish(&self.frames, &self.case, start_ns)?;
        Ok(RoundTrip { start_ns, sent_ns, received_ns: 0 })
    }

    /// Takes the answer if it is there.
    fn receive(&self, trip: &mut RoundTrip) -> anyhow::Result<Option<i64>> {
        let Some(answer) = self.answers.receive()? else {
            anyhow::ensure!(now_ns() - trip.start_ns < PATIENCE_NS, "the peer does not answer");
            return Ok(None);
        };
        trip.received_ns = now_ns();
        self.case.read(answer.items(), self.expected_sum)?;
        Ok(Some(trip.one_way_ns(self.case.measure, &answer.header().frame)))
    }
}

impl<const LARGE: bool> Link for SharedMemory<LARGE> {
    fn round_trips(&mut self, count: u64, record: &mut dyn FnMut(i64)) -> anyhow::Result<()> {
        let mut left = count;
        let mut trip = self.send()?;
        let mut look = || -> anyhow::Result<bool> {
            while let Some(one_way_ns) = self.receive(&mut trip)? {
                record(one_way_ns);
                left -= 1;
                if left == 0 {
                    return Ok(true);
                }
                trip = self.send()?;
            }
            Ok(false)
        };
        if self.wake_up != WakeUp::WaitSet {
            while !look()? {
                match self.wake_up {
                    WakeUp::Spin => std::hint::spin_loop(),
                    _ => self.listeners[0].wait(LOOK_AGAIN)?,
                }
            }
            return Ok(());
        }
        wait_on(&self.listeners, |wake| match (wake, look()) {
            (Wake::Stop, _) => ControlFlow::Break(Err(anyhow!("interrupted"))),
            (_, Err(error)) => ControlFlow::Break(Err(error)),
            (_, Ok(true)) => ControlFlow::Break(Ok(())),
            (_, Ok(false)) => ControlFlow::Continue(LOOK_AGAIN),
        })?
    }
}

/// Writes a frame into shared memory and hands it over; returns when that was.
fn publish<S>(port: &FramePublisher<S>, case: &Case, arrival_ns: i64) -> Result<i64, PortError>
where
    S: FrameService<Header = ScanHeader, Item = Point>,
{
    let mut sent_ns = 0;
    let header = || {
        sent_ns = now_ns();
        let frame = FrameHeader { arrival_ns, sent_ns, ..FrameHeader::default() };
        ScanHeader { frame, points: case.points as u32, ..ScanHeader::default() }
    };
    port.publish(case.points, |index| case.point(index), header)?;
    Ok(sent_ns)
}
