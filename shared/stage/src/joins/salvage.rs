//! Frames that a sink which was killed had not written down: their poses and scans are in their writers' history, and what they have
//! changed in the map comes with its snapshot.

use evac_frames::{FrameHeader, MapHeader, PoseFrame};
use evac_ports::now_ns;

use super::map::MapStream;

/// What is left to be handed on before the map's first message.
#[derive(Debug, Default)]
pub(super) struct Salvage {
    /// The first frame that was not written down, and until when partners are waited for, host monotonic time.
    from: Option<(u64, i64)>,
    /// This frame comes again, as a snapshot, and is done with then.
    again: Option<u64>,
}

/// What to do before the map's next message.
pub(super) enum Before {
    Nothing,
    /// What is in the history has not come yet.
    Wait,
    /// Hand on the pose of a frame up to this one, with this header of the map.
    Frame {
        from: u64,
        last: u64,
        header: MapHeader,
    },
}

impl Salvage {
    pub(super) fn resume(&mut self, after: Option<u64>, patience_ns: i64) {
        self.from = after.map(|seq| (seq.saturating_add(1), now_ns().saturating_add(patience_ns)));
    }

    /// `reaches` says whether what is in the history has come up to a frame.
    pub(super) fn before(&self, map: &MapStream, reaches: impl Fn(u64) -> bool) -> Before {
        let (Some((from, until_ns)), Some(front)) = (self.from, map.front()) else { return Before::Nothing };
        let end = front.seq().saturating_add(u64::from(front.is_snapshot()));
        let Some(last) = end.checked_sub(1).filter(|last| *last >= from) else { return Before::Nothing };
        if !reaches(last) && now_ns() < until_ns {
            return Before::Wait;
        }
        Before::Frame { from, last, header: *front.header() }
    }

    /// The header of a frame of which the map says nothing by itself.
    pub(super) fn header(&mut self, map: &MapHeader, pose: &PoseFrame) -> MapHeader {
        if let Some((from, _)) = &mut self.from {
            *from = pose.frame.seq.saturating_add(1);
        }
        self.again = (pose.frame.seq == map.frame.seq).then_some(pose.frame.seq);
        MapHeader {
            frame: FrameHeader { flags: 0, ..pose.frame },
            resolution: map.resolution,
            position: pose.position,
            map_epoch: map.map_epoch,
            ..MapHeader::default()
        }
    }

    pub(super) fn end(&mut self) {
        self.from = None;
    }

    /// The first frame that is still to be handed on, as far as it is known.
    pub(super) fn first(&self, map: &MapStream) -> Option<u64> {
        self.from.map(|(from, _)| from).or_else(|| map.first())
    }

    pub(super) fn done(&mut self, frame: &FrameHeader) -> Option<FrameHeader> {
        if self.again.take_if(|seq| *seq == frame.seq).is_some() { None } else { Some(*frame) }
    }

    pub(super) fn deadline_ns(&self, map: &MapStream) -> Option<i64> {
        let waits = map.front().and(self.from).map(|(_, until_ns)| until_ns);
        waits.or_else(|| map.deadline_ns())
    }
}
