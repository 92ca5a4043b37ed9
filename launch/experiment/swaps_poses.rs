//! The pose stream while odometries take each other's place: its steps beside the true ones, and its gaps.

use std::collections::VecDeque;

use evac_frames::{PoseFrame, TrackingState};
use evac_geometry::map_from_lidar;

use super::swaps_report::{Cut, Gap, Swaps};

/// A gap of the pose stream longer than this is listed, 1.5 periods.
const LONG_GAP_NS: i64 = 150_000_000;
/// True poses kept until the pose of their scan comes.
const MAX_TRUTH: usize = 256;

/// What was seen of the pose stream.
#[derive(Debug, Default)]
pub(super) struct Poses {
    truth: VecDeque<PoseFrame>,
    last: Option<PoseFrame>,
    frames: u64,
    cuts: Vec<Cut>,
    /// Worst step that is no cut, metres.
    elsewhere_m: f64,
    gap_ns: i64,
    long_gaps: Vec<Gap>,
}

impl Poses {
    pub(super) fn take_truth(&mut self, truth: PoseFrame) {
        self.truth.push_back(truth);
        if self.truth.len() > MAX_TRUTH {
            self.truth.pop_front();
        }
    }

    /// Takes all that has come. What several instances sent comes in any order, and what a killed one said last the next one says once more:
    /// of two copies that of the older instance counts, whose step and time it is.
    pub(super) fn take(&mut self, come: &mut Vec<PoseFrame>) {
        come.sort_by_key(|pose| (pose.frame.seq, pose.frame.epoch));
        for pose in come.drain(..) {
            if self.last.is_none_or(|last| pose.frame.seq > last.frame.seq) {
                self.take_next(&pose);
            }
        }
    }

    fn take_next(&mut self, pose: &PoseFrame) {
        self.frames += 1;
        let Some(last) = self.last.replace(*pose) else { return };
        let gap_ns = pose.frame.sent_ns - last.frame.sent_ns;
        self.gap_ns = self.gap_ns.max(gap_ns);
        if gap_ns > LONG_GAP_NS {
            self.long_gaps.push(Gap { seq: pose.frame.seq, ms: gap_ns as f64 * 1e-6 });
        }
        let error = self.step_error(&last, pose);
        if last.frame.epoch != pose.frame.epoch {
            // A step that cannot be judged is no good one.
            let (off_m, off_rad) = error.unwrap_or((f64::INFINITY, f64::INFINITY));
            self.cuts.push(Cut { seq: pose.frame.seq, off_m, off_deg: off_rad.to_degrees() });
        } else if let Some((off_m, _)) = error {
            self.elsewhere_m = self.elsewhere_m.max(off_m);
        }
    }

    /// The newest pose's frame.
    pub(super) fn newest(&self) -> u64 {
        self.last.map_or(0, |last| last.frame.seq)
    }

    /// How far the step between two poses is off the true one, metres and radians; nothing where an odometry does not track.
    fn step_error(&self, before: &PoseFrame, after: &PoseFrame) -> Option<(f64, f64)> {
        let tracks = |pose: &PoseFrame| {
            matches!(pose.tracking_state(), Some(TrackingState::Tracking | TrackingState::Degenerate))
        };
        if !(tracks(before) && tracks(after)) {
            return None;
        }
        let truth = |seq: u64| self.truth.iter().find(|truth| truth.frame.seq == seq);
        let (true_before, true_after) = (truth(before.frame.seq)?, truth(after.frame.seq)?);
        let step = |a: &PoseFrame, b: &PoseFrame| map_from_lidar(a).inverse() * map_from_lidar(b);
        let error = step(true_before, true_after).inverse() * step(before, after);
        Some((error.translation.vector.norm(), error.rotation.angle()))
    }

    pub(super) fn finish(&self, swaps: &mut Swaps) {
        swaps.frames = self.frames;
        swaps.odometry_cuts.clone_from(&self.cuts);
        swaps.elsewhere_m = self.elsewhere_m;
        swaps.long_gaps.clone_from(&self.long_gaps);
        swaps.longest_gap_ms = self.gap_ns as f64 * 1e-6;
    }
}

#[cfg(test)]
mod tests {
    use evac_frames::FrameHeader;

    use super::*;

    fn pose(seq: u64, epoch: u32, x: f64, sent_ms: i64) -> PoseFrame {
        PoseFrame {
            frame: FrameHeader { seq, epoch, sent_ns: sent_ms * 1_000_000, ..FrameHeader::default() },
            position: [x, 0.0, 0.0],
            orientation: [0.0, 0.0, 0.0, 1.0],
            state: TrackingState::Tracking as u32,
            ..PoseFrame::default()
        }
    }

    #[test]
    fn a_step_of_an_instance_that_was_killed_is_not_laid_to_the_one_that_says_it_once_more() {
        let mut poses = Poses::default();
        for seq in 0..5 {
            poses.take_truth(pose(seq, 0, 0.1 * seq as f64, 0));
        }
        poses.take(&mut vec![pose(0, 0, 0.0, 0), pose(1, 0, 0.1, 100)]);
        // The old one jumped by 0.15 m in frame 2 and was killed; what the new one sent is read first.
        let (again, first) = (pose(2, 1, 0.35, 270), pose(3, 1, 0.451, 330));
        poses.take(&mut vec![again, first, pose(2, 0, 0.35, 200)]);
        poses.take(&mut vec![again, pose(4, 1, 0.55, 400)]);
        let mut swaps = Swaps::default();
        poses.finish(&mut swaps);
        assert_eq!((swaps.frames, swaps.odometry_cuts.len(), swaps.odometry_cuts[0].seq), (5, 1, 3));
        assert!((swaps.odometry_cuts[0].off_m - 0.001).abs() < 1e-9, "{:?}", swaps.odometry_cuts);
        assert!((swaps.elsewhere_m - 0.15).abs() < 1e-9 && swaps.longest_gap_ms == 130.0, "{swaps:?}");
    }
}
