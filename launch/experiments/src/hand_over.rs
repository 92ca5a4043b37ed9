//! One odometry hands over to the other again and again in a walk, and what the pose does then.
//!
//! The old instance goes on for the frame of the cut, unheard, so that what the swap does and what the odometry would have done anyway
//! can be told apart.

use evac_deskewer::Deskewer;
use evac_frames::PoseFrame;
use evac_geometry::map_from_lidar;
use evac_geometry::nalgebra::Isometry3;
use evac_odometry::{Lio, Loam};
use evac_stage::{Counters, PoseOutput, Readiness, Rig, ScanOutput, ScanWithImu, Stage as _, StageError};

use crate::{OdometryKind, Settings, Walk};

/// What happened at one cut.
#[derive(Debug, Clone, Copy)]
pub struct HandOver {
    /// First frame of the new instance.
    pub frame: usize,
    /// Kind of the new instance.
    pub to: OdometryKind,
    /// Frames that the new instance followed until it was ready.
    pub ready_after: usize,
    /// The published step over the cut beside the true one, metres and radians.
    pub step: (f64, f64),
    /// The old instance's step to that frame beside the true one: what the odometry would have been off without the swap.
    pub old_step: (f64, f64),
    /// The new instance's pose beside what the old one would have published.
    pub beside: (f64, f64),
}

/// What is known of a standby before a frame, for whoever decides whether it leads from that frame on.
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    /// The frame.
    pub frame: usize,
    /// Frames that the standby has followed.
    pub followed: usize,
    /// Whether it was ready after the last of them, and after the one before: the launcher's knowledge when the leading one is killed
    /// right after its last frame.
    pub ready: [bool; 2],
}

/// Either odometry.
#[derive(Debug)]
enum Odometry {
    Lio(Box<Lio>),
    Loam(Box<Loam>),
}

impl Odometry {
    fn new(kind: OdometryKind, settings: &Settings, rig: &Rig) -> Result<Self, StageError> {
        Ok(match kind {
            OdometryKind::Lio => Self::Lio(Box::new(Lio::new(settings.lio, rig)?)),
            OdometryKind::Loam => Self::Loam(Box::new(Loam::new(settings.loam, rig)?)),
        })
    }

    fn process(&mut self, input: ScanWithImu<'_>) -> Result<PoseFrame, StageError> {
        let (mut output, mut counters) = (PoseOutput::newest_only(), Counters::default());
        match self {
            Self::Lio(lio) => lio.process(input, &mut output, &mut counters)?,
            Self::Loam(loam) => loam.process(input, &mut output, &mut counters)?,
        }
        Ok(output.memory.last().copied().unwrap_or_default())
    }

    fn follow(&mut self, input: ScanWithImu<'_>, routed: &PoseFrame) -> Result<Readiness, StageError> {
        match self {
            Self::Lio(lio) => lio.follow(input, Some(routed)),
            Self::Loam(loam) => loam.follow(input, Some(routed)),
        }
    }
}

/// The other one.
fn other(kind: OdometryKind) -> OdometryKind {
    match kind {
        OdometryKind::Lio => OdometryKind::Loam,
        OdometryKind::Loam => OdometryKind::Lio,
    }
}

/// Frames before the first standby: the odometry finds its start.
const START: usize = 40;

/// Runs a walk in which the odometry becomes the other one whenever `is_due` says so of a standby that is ready or was. Gives the cuts and
/// every published pose.
///
/// # Errors
/// [`StageError`] of a stage that refuses its configuration or gives up.
pub fn hand_overs(
    walk: &Walk,
    settings: &Settings,
    mut is_due: impl FnMut(&Moment) -> bool,
) -> Result<(Vec<HandOver>, Vec<PoseFrame>), StageError> {
    let mut deskewer = Deskewer::new(settings.deskewer.clone(), &walk.rig)?;
    let mut scans = ScanOutput::newest_only();
    let mut kind = settings.odometry;
    let mut leads = Odometry::new(kind, settings, &walk.rig)?;
    let mut follows: Option<(Odometry, usize)> = None;
    let (mut cuts, mut poses): (Vec<HandOver>, Vec<PoseFrame>) = (Vec::new(), Vec::new());
    let (mut ready_after, mut ready) = (None, [false; 2]);
    for (index, frame) in walk.frames.iter().enumerate() {
        let prior = poses.last();
        let raw = ScanWithImu {
            header: &frame.header,
            points: &frame.points,
            imu: &frame.imu,
            imu_covers: !frame.imu.is_empty(),
            prior,
        };
        deskewer.process(raw, &mut scans, &mut Counters::default())?;
        let Some((header, points)) = scans.memory.last() else { continue };
        let input = || ScanWithImu {
            header,
            points,
            imu: &frame.imu,
            imu_covers: !frame.imu.is_empty(),
            prior: None,
        };
        // The old one's, were it not for the cut.
        let routed = leads.process(input())?;
        let step = |pose: &PoseFrame| {
            let before =
                index.checked_sub(1).and_then(|before| Some((poses.get(before)?, walk.frames.get(before)?)));
            before.map_or((0.0, 0.0), |(last, at)| {
                let truth = at.truth.inverse() * frame.truth;
                distance(&truth, &(map_from_lidar(last).inverse() * map_from_lidar(pose)))
            })
        };
        let moment =
            follows.as_ref().map(|(_, since)| Moment { frame: index, followed: index - since, ready });
        let is_cut = moment.is_some_and(|moment| ready != [false; 2] && is_due(&moment));
        if is_cut && let Some((mut new, _)) = follows.take() {
            kind = other(kind);
            let pose = new.process(input())?;
            cuts.push(HandOver {
                frame: index,
                to: kind,
                ready_after: ready_after.take().unwrap_or_default(),
                step: step(&pose),
                old_step: step(&routed),
                beside: distance(&map_from_lidar(&routed), &map_from_lidar(&pose)),
            });
            (leads, ready) = (new, [false; 2]);
            poses.push(pose);
            continue;
        }
        poses.push(routed);
        if follows.is_none() && index > START {
            follows = Some((Odometry::new(other(kind), settings, &walk.rig)?, index));
        }
        if let Some((new, since)) = &mut follows {
            let readiness = new.follow(input(), &routed)?;
            ready = [readiness == Readiness::Ready, ready[0]];
            ready_after = ready_after.or(ready[0].then_some(index - *since)).filter(|_| ready != [false; 2]);
        }
    }
    Ok((cuts, poses))
}

/// Between two poses or steps, metres and radians.
fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    let error = a.inverse() * b;
    (error.translation.vector.norm(), error.rotation.angle())
}
