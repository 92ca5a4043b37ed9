//! What is sent, what is done with it and what is timed.

use std::fmt;

use evac_frames::{FrameHeader, Point};
use evac_ports::now_ns;

/// What is timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measure {
    /// From handing over a frame that is written to having all of it readable in the other process.
    Transport,
    /// Writing every point, the transport, and summing every word: half a round trip.
    WriteAndSum,
}

/// One payload and what is timed of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Case {
    pub(crate) points: usize,
    pub(crate) measure: Measure,
}

impl Case {
    /// 1 KiB, 64 KiB, 384 KiB (a scan of 24,000 points) and 4 MiB (a map snapshot), then a scan with the work on it.
    pub(crate) const ALL: [Self; 5] = [
        Self { points: 64, measure: Measure::Transport },
        Self { points: 4_096, measure: Measure::Transport },
        Self { points: 24_576, measure: Measure::Transport },
        Self { points: Self::MAX_POINTS, measure: Measure::Transport },
        Self { points: 24_576, measure: Measure::WriteAndSum },
    ];
    pub(crate) const MAX_POINTS: usize = 262_144;

    /// Whether every point is written and read.
    pub(crate) fn is_read(&self) -> bool {
        self.measure == Measure::WriteAndSum
    }

    /// The point that is written at `index`.
    pub(crate) fn point(&self, index: usize) -> Point {
        match self.measure {
            Measure::Transport => Point::default(),
            Measure::WriteAndSum => Point { x: index as f32, y: 1.0, z: -1.0, packed: index as u32 },
        }
    }

    /// Reads all of a frame if that is part of the case.
    ///
    /// # Errors
    /// What came is not what was sent.
    pub(crate) fn read(&self, points: &[Point], expected_sum: u64) -> anyhow::Result<()> {
        anyhow::ensure!(points.len() == self.points, "{} of {} points came", points.len(), self.points);
        if self.measure == Measure::WriteAndSum {
            let sum = sum(points);
            anyhow::ensure!(sum == expected_sum, "the payload's sum is {sum} and not {expected_sum}");
        }
        Ok(())
    }

    /// What [`Self::read`] must find.
    pub(crate) fn expected_sum(&self) -> u64 {
        let points: Vec<_> = (0..self.points).map(|index| self.point(index)).collect();
        sum(&points)
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kib = self.points * size_of::<Point>() / 1024;
        let size = if kib < 1024 { format!("{kib} KiB") } else { format!("{} MiB", kib / 1024) };
        match self.measure {
            Measure::Transport => f.write_str(&size),
            Measure::WriteAndSum => write!(f, "{size}, write all and sum all"),
        }
    }
}

/// Sum of all 32-bit words: integers, so that it costs memory traffic and not floating-point latency.
fn sum(points: &[Point]) -> u64 {
    bytemuck::cast_slice::<Point, u32>(points).iter().map(|word| u64::from(*word)).sum()
}

/// The moments of one round trip, host monotonic nanoseconds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RoundTrip {
    /// Before the first point was written.
    pub(crate) start_ns: i64,
    /// When the written frame was handed over.
    pub(crate) sent_ns: i64,
    /// When the answer was readable.
    pub(crate) received_ns: i64,
}

impl RoundTrip {
    /// One way of the round trip that has just ended, nanoseconds. In the answer's header the peer says when the frame
    /// was readable on its side (`arrival_ns`) and when it handed the answer over (`sent_ns`).
    pub(crate) fn one_way_ns(&self, measure: Measure, answer: &FrameHeader) -> i64 {
        let both = match measure {
            Measure::Transport => (answer.arrival_ns - self.sent_ns) + (self.received_ns - answer.sent_ns),
            Measure::WriteAndSum => now_ns() - self.start_ns,
        };
        both / 2
    }
}

/// One side of a connection to a peer that answers every frame with one of the same length.
pub(crate) trait Link {
    /// Makes `count` round trips and gives each one's one-way time in nanoseconds to `record`.
    ///
    /// # Errors
    /// The peer does not answer, or not with what it should, or SIGINT or SIGTERM has come.
    fn round_trips(&mut self, count: u64, record: &mut dyn FnMut(i64)) -> anyhow::Result<()>;
}
