//! How far the map drifts from its origin within its sections.
//!
//! Along a tunnel or through a hall no pose is ever uncertain enough to begin a section, and yet each piece of new ground is laid from a
//! pose that is known to millimetres and tenths of milliradians only, against the ground before it. Once the view has changed,
//! all that the filter matches with is off by that, and so is what is laid next. The filter does not see it: it counts errors
//! against what is in view. So each piece of ground remembers how uncertain its place was when it was laid: as uncertain as what was in
//! view then, and as the pose against that. The pose is published with the uncertainty against what is in view and that of what is
//! in view against the origin, which on old ground is again what it was there.
//!
//! Back on old ground the pose steps by what has drifted since: gravity and velocity, known against the newer ground, turn along with it
//! only if the filter knows that the ground may be turned. Otherwise gravity lies askew by a tenth of a degree, and in the next corridor that makes
//! decimetres.

use super::offset::PoseCovariance;

/// Share of a view that is new before it counts as a piece of its own.
const PIECE: f64 = 0.1;
/// Pieces that are told apart, 300 kB; beyond them neighbours become one.
const MAX_PIECES: usize = 1024;
/// Share of the pose's variance that new ground inherits. Poses of one view share nearly all of their error, so in each view the drift grows
/// by one pose's; the mean over a view whose ground grows steadily worse is that of its middle, and half of the newest is half a
/// view's growth ahead of it.
const INHERITED: f64 = 0.5;

/// How fast the pose is counted against newer ground in view, of the way there in a scan.
const FOLLOWING: f64 = 0.1;

/// Number of a piece of ground, in the order in which they were laid.
pub(crate) type Piece = u32;

/// The drift of each piece against the origin: covariance of a displacement of the map (rotation about its axes, displacement).
#[derive(Debug)]
pub(crate) struct Drift {
    /// Each stands for 2 to the power of `merged` numbers.
    pieces: Vec<PoseCovariance>,
    merged: u32,
    /// Points of a scan that see each piece, for [`Self::look`].
    tally: Vec<u32>,
    /// How much of a piece is laid since the newest began, in pieces.
    laid: f64,
    view: PoseCovariance,
    /// Drift of the ground that the pose is counted against.
    counted: PoseCovariance,
}

impl Drift {
    pub(crate) fn new() -> Self {
        let mut drift = Self {
            pieces: Vec::with_capacity(MAX_PIECES),
            merged: 0,
            tally: vec![0; MAX_PIECES],
            laid: 0.0,
            view: PoseCovariance::zeros(),
            counted: PoseCovariance::zeros(),
        };
        drift.clear();
        drift
    }

    /// All ground is that of the origin again.
    pub(crate) fn clear(&mut self) {
        self.pieces.clear();
        self.pieces.push(PoseCovariance::zeros());
        (self.merged, self.laid) = (0, 0.0);
        (self.view, self.counted) = (PoseCovariance::zeros(), PoseCovariance::zeros());
    }

    /// The piece that new cells belong to.
    pub(crate) fn current(&self) -> Piece {
        (self.pieces.len() as Piece - 1) << self.merged
    }

    /// Drift of what is in view.
    pub(crate) fn of_view(&self) -> &PoseCovariance {
        &self.view
    }

    /// Takes the mean over the points of a scan, each with the piece that it sees; a scan that sees none leaves it as it was.
    pub(crate) fn look(&mut self, points: impl Iterator<Item = Piece>) {
        self.tally.fill(0);
        let mut count = 0;
        for piece in points {
            if let Some(tally) = self.tally.get_mut((piece >> self.merged) as usize) {
                *tally += 1;
                count += 1;
            }
        }
        if count == 0 {
            return;
        }
        self.view = PoseCovariance::zeros();
        for (drift, points) in self.pieces.iter().zip(&self.tally).filter(|(_, points)| **points > 0) {
            self.view += drift * (f64::from(*points) / f64::from(count));
        }
    }

    /// How uncertain the ground in view lies to that which the pose was counted against, if it is older: by what that had
    /// drifted more. Newer ground is laid from the pose itself.
    pub(crate) fn come_back(&mut self) -> Option<PoseCovariance> {
        let turn = |drift: &PoseCovariance| drift.fixed_view::<3, 3>(0, 0).trace();
        let (now, before) = (turn(&self.view), turn(&self.counted));
        if now >= before {
            self.counted += (self.view - self.counted) * FOLLOWING;
            return None;
        }
        let back = self.counted * (1.0 - now / before);
        self.counted = self.view;
        Some(back)
    }

    /// A scan of which the share `unseen` shows new ground is laid from a pose whose error is `pose`, as a displacement of the map.
    pub(crate) fn lay(&mut self, unseen: f64, pose: &PoseCovariance) {
        self.laid += unseen / PIECE;
        if self.laid < f64::from(1_u32 << self.merged) {
            return;
        }
        self.laid = 0.0;
        if self.pieces.len() == MAX_PIECES {
            for index in 0..MAX_PIECES / 2 {
                // Of two that become one the later, which as a rule has drifted more.
                self.pieces[index] = self.pieces[2 * index + 1];
            }
            self.pieces.truncate(MAX_PIECES / 2);
            self.merged += 1;
        }
        self.pieces.push(self.view + pose * INHERITED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 3 mm and 0.3 mrad.
    fn pose() -> PoseCovariance {
        let mut pose = PoseCovariance::identity() * 0.003_f64.powi(2);
        pose.fixed_view_mut::<3, 3>(0, 0).scale_mut(0.01);
        pose
    }

    /// A walk of so many views, of which the last is always in sight: returns the drift of what is seen at its end.
    fn walk(drift: &mut Drift, views: u32) -> f64 {
        let step = 0.02;
        let mut laid = vec![drift.current(); 50];
        for _ in 0..(f64::from(views) / step) as u32 {
            drift.look(laid.iter().rev().take(50).copied());
            drift.lay(step, &pose());
            laid.push(drift.current());
        }
        drift.look(laid.iter().rev().take(50).copied());
        drift.of_view()[(3, 3)]
    }

    #[test]
    fn the_drift_grows_by_about_one_pose_in_each_view() {
        let mut drift = Drift::new();
        let variance = walk(&mut drift, 20);
        let poses = variance / pose()[(3, 3)];
        assert!((14.0..26.0).contains(&poses), "{poses}");
    }

    #[test]
    fn back_on_the_ground_of_the_start_nothing_has_drifted_and_new_ground_there_is_good() {
        let mut drift = Drift::new();
        let far = walk(&mut drift, 10);
        drift.look([0; 100].into_iter());
        assert_eq!(drift.of_view(), &PoseCovariance::zeros());
        drift.lay(0.2, &pose());
        let there = drift.current();
        drift.look([there].into_iter());
        assert!(drift.of_view()[(3, 3)] < far / 5.0);
    }

    #[test]
    fn old_ground_that_comes_into_view_is_as_uncertain_as_what_has_drifted_since_and_only_once() {
        let mut drift = Drift::new();
        let far = walk(&mut drift, 10);
        assert_eq!(drift.come_back(), None);
        for _ in 0..100 {
            assert_eq!(drift.come_back(), None);
        }
        drift.look([0; 100].into_iter());
        let back = drift.come_back().unwrap()[(3, 3)];
        assert!((back / far - 1.0).abs() < 0.01, "{back} {far}");
        assert_eq!(drift.come_back(), None);
    }

    #[test]
    fn a_scan_that_sees_nothing_known_leaves_what_was_known_of_the_drift() {
        let mut drift = Drift::new();
        let before = walk(&mut drift, 3);
        drift.look(std::iter::empty());
        assert_eq!(drift.of_view()[(3, 3)], before);
    }

    #[test]
    fn a_walk_without_end_takes_no_more_memory_and_old_ground_is_still_told_from_new() {
        let mut drift = Drift::new();
        walk(&mut drift, 50);
        let early = drift.current();
        let late = walk(&mut drift, 400);
        assert!(
            drift.pieces.len() <= MAX_PIECES && drift.pieces.capacity() == MAX_PIECES && drift.merged > 1
        );
        drift.look([early].into_iter());
        let back = drift.of_view()[(3, 3)];
        assert!(back > 0.0 && back < late / 4.0, "{back} {late}");
    }
}
