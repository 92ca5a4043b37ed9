//! What travels: a header and points, in Zenoh's shared memory, as `ipc_hop` sends them in evac's.

use anyhow::{anyhow, ensure};
use rustix::time::{ClockId, clock_gettime};
use zenoh::Wait as _;
use zenoh::pubsub::Publisher;
use zenoh::sample::Sample;
use zenoh::shm::{BlockOn, GarbageCollect, PosixShmProviderBackend, ShmProvider, ShmProviderBuilder};

/// Bytes of a point: three floats and a word.
const POINT: usize = 16;
/// Bytes of the header: two stamps of eight, and room.
const HEADER: usize = 32;
/// Memory of one end: frames of 4 MiB that the other end may still hold.
const MEMORY: usize = 64 << 20;

/// Nanoseconds of the host's monotonic clock, which both ends and the bench share.
pub(crate) fn now_ns() -> i64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

pub(crate) fn failed(cause: zenoh::Error) -> anyhow::Error {
    anyhow!("zenoh: {cause}")
}

/// The moments in a header, host monotonic nanoseconds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stamps {
    /// When the frame that is answered was readable; -1 from who has done with its peer.
    pub(crate) arrival_ns: i64,
    /// When this frame was handed over.
    pub(crate) sent_ns: i64,
}

/// One payload, and whether it is written and read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Case {
    pub(crate) points: usize,
    pub(crate) is_read: bool,
}

impl Case {
    /// Writes every point: zeros, or what [`Self::expected_sum`] is of.
    fn fill(&self, points: &mut [u8]) {
        if !self.is_read {
            points.fill(0);
            return;
        }
        for (index, point) in points.chunks_exact_mut(POINT).enumerate() {
            point.copy_from_slice(&self.point(index));
        }
    }

    fn point(&self, index: usize) -> [u8; POINT] {
        let words = [(index as f32).to_bits(), 1_f32.to_bits(), (-1_f32).to_bits(), index as u32];
        let mut bytes = [0; POINT];
        for (place, word) in bytes.chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }

    pub(crate) fn expected_sum(&self) -> u64 {
        (0..self.points).map(|index| sum(&self.point(index))).sum()
    }

    /// Reads a frame: its stamps. Where that is part of the case all of it is summed.
    ///
    /// # Errors
    /// It came as bytes instead of shared memory, or is not what was sent.
    pub(crate) fn read(&self, sample: &Sample, expected_sum: u64) -> anyhow::Result<Stamps> {
        let frame = sample.payload().as_shm().ok_or_else(|| anyhow!("bytes came instead of shared memory"))?;
        let (header, points) =
            frame.split_at_checked(HEADER).ok_or_else(|| anyhow!("a frame is too short"))?;
        let points_came = points.len() / POINT;
        ensure!(points_came == self.points, "{points_came} of {} points came", self.points);
        if self.is_read {
            let sum = sum(points);
            ensure!(sum == expected_sum, "the payload's sum is {sum} and not {expected_sum}");
        }
        let stamp = |at: usize| -> anyhow::Result<i64> { Ok(i64::from_le_bytes(header[at..at + 8].try_into()?)) };
        Ok(Stamps { arrival_ns: stamp(0)?, sent_ns: stamp(8)? })
    }
}

/// Sum of all 32-bit words.
fn sum(points: &[u8]) -> u64 {
    points.chunks_exact(4).map(|word| u64::from(u32::from_le_bytes([word[0], word[1], word[2], word[3]]))).sum()
}

/// Sends frames.
pub(crate) struct Output {
    publisher: Publisher<'static>,
    memory: ShmProvider<PosixShmProviderBackend>,
    case: Case,
}

impl Output {
    pub(crate) fn new(publisher: Publisher<'static>, case: Case) -> anyhow::Result<Self> {
        let memory = ShmProviderBuilder::default_backend(MEMORY).wait().map_err(failed)?;
        Ok(Self { publisher, memory, case })
    }

    /// Loans memory, writes every point into it and hands it over; gives when that was.
    pub(crate) fn send(&self, arrival_ns: i64) -> anyhow::Result<i64> {
        let bytes = HEADER + self.case.points * POINT;
        let loan = self.memory.alloc(bytes).with_policy::<BlockOn<GarbageCollect>>().wait();
        let mut frame = loan.map_err(|cause| anyhow!("zenoh: no shared memory: {cause:?}"))?;
        let (header, points) = frame.split_at_mut(HEADER);
        self.case.fill(points);
        let sent_ns = now_ns();
        header[..8].copy_from_slice(&arrival_ns.to_le_bytes());
        header[8..16].copy_from_slice(&sent_ns.to_le_bytes());
        self.publisher.put(frame).wait().map_err(failed)?;
        Ok(sent_ns)
    }
}
