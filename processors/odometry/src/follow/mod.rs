//! A standby: its filter and map are kept where the routed odometry is, so that it goes on from there in the same map frame.
//!
//! For a while it lays scans at the routed poses. From then on it tracks by itself, is put back onto the routed pose every
//! [`FREE_FRAMES`], and is ready when it has kept to the routed poses for as long: a wrong velocity, its own or the routed one's, shows only
//! where nobody is led by the hand. What both differ by when it takes over is let go of slowly ([`seam`]).

mod seam;

use evac_frames::{PoseFrame, TrackingState};
use evac_geometry::map_from_imu;
use evac_geometry::nalgebra::Isometry3;
use evac_stage::{Counters, Readiness, ScanWithImu};

use seam::Seam;

/// Frames that it tracks on its own before it takes the routed pose over, and that must agree with that in a row until it is ready.
const FREE_FRAMES: u32 = 10;
/// Farther off it is ready no more, metres and radians. (In between it takes over when the routed one dies: that is better than to
/// begin anew.)
const KEPT: (f64, f64) = (0.1, 0.02);
/// Frames without being ready after which the map is begun anew: one that was laid around a corner may be no good.
const UNREADY_FRAMES: u32 = 30;

/// An odometry that can be a standby.
pub(crate) trait Standby {
    /// Frames whose scans are laid at the routed poses before the first match.
    const WARM_FRAMES: u32;
    /// How far an agreeing pose may be off, metres and radians.
    const AGREEING: (f64, f64);

    fn following(&mut self) -> &mut Following;

    /// As if it led.
    fn track(&mut self, input: &ScanWithImu<'_>, counters: &mut Counters) -> PoseFrame;

    /// Lays the scan at the routed pose; `is_first` forgets whatever was before.
    fn lay(&mut self, input: &ScanWithImu<'_>, routed: &PoseFrame, is_first: bool);

    /// Its `map_from_imu`; nothing before the start.
    fn pose(&self) -> Option<Isometry3<f64>>;

    /// Takes over the routed pose, velocity and biases.
    fn take_over(&mut self, routed: &PoseFrame);
}

/// How far a standby is, and what is left of it when it leads.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Following {
    frames: u32,
    /// Of these, since it took the routed pose over.
    free: u32,
    agreeing: u32,
    unready: u32,
    is_ready: bool,
    /// From its own pose to the routed one in the frame before this one, where that was followed.
    stream_from_own: Option<Isometry3<f64>>,
    /// Where the IMU alone has carried the last state to; nothing where there was none, or no IMU.
    predicted: Option<Isometry3<f64>>,
    seam: Option<Seam>,
}

impl Following {
    /// Takes note of the motion that a match is about to correct.
    pub(crate) fn predict(&mut self, map_from_imu: Option<Isometry3<f64>>) {
        self.predicted = map_from_imu;
    }
}

/// A frame of a standby.
pub(crate) fn follow<S: Standby>(
    stage: &mut S,
    input: &ScanWithImu<'_>,
    routed: Option<&PoseFrame>,
) -> Readiness {
    let Some(routed) = routed.filter(|pose| is_usable(pose)) else {
        // The routed odometry waits for its start, or is lost: so is this one.
        stage.track(input, &mut Counters::default());
        *stage.following() = Following::default();
        return Readiness::Following;
    };
    let mut following = *stage.following();
    let there = map_from_imu(routed);
    if following.frames < S::WARM_FRAMES {
        stage.lay(input, routed, following.frames == 0);
    } else {
        stage.track(input, &mut Counters::default());
        let off = stage.pose().map(|own| distance(&own, &there));
        following.compare(off, S::AGREEING);
        if following.agreeing == 0 || following.free >= FREE_FRAMES {
            following.free = 0;
            stage.take_over(routed);
        }
    }
    following.frames = following.frames.saturating_add(1);
    following.stream_from_own = stage.pose().map(|own| there * own.inverse());
    if following.unready >= UNREADY_FRAMES {
        following = Following::default();
    }
    *stage.following() = following;
    if following.is_ready { Readiness::Ready } else { Readiness::Following }
}

impl Following {
    /// Judges a frame in which it was on its own and so far off.
    fn compare(&mut self, off: Option<(f64, f64)>, agreeing: (f64, f64)) {
        let within = |limit: (f64, f64)| off.is_some_and(|off| off.0 < limit.0 && off.1 < limit.1);
        self.free += 1;
        self.agreeing = if within(agreeing) { self.agreeing + 1 } else { 0 };
        self.is_ready = within(KEPT) && (self.is_ready || self.agreeing >= FREE_FRAMES);
        self.unready = if self.is_ready { 0 } else { self.unready + 1 };
    }
}

/// A frame of an instance that leads, whether it has followed another or not.
pub(crate) fn lead<S: Standby>(
    stage: &mut S,
    input: &ScanWithImu<'_>,
    counters: &mut Counters,
    imu_from_lidar: &Isometry3<f64>,
) -> PoseFrame {
    stage.following().predicted = None;
    let mut pose = stage.track(input, counters);
    let own = stage.pose();
    let following = stage.following();
    if let Some(stream_from_own) = following.stream_from_own.take()
        && let (Some(own), Some(predicted)) = (own, following.predicted)
    {
        following.seam = Some(Seam::between(&own, &(stream_from_own * predicted), pose.frame.end_ns));
    }
    // A lost odometry or one that begins anew has no place that the stream could be led to.
    following.seam =
        following.seam.filter(|_| is_usable(&pose)).filter(|seam| seam.close(&mut pose, imu_from_lidar));
    pose
}

/// Whether the routed pose says where the rig is, and all its numbers can be true.
fn is_usable(pose: &PoseFrame) -> bool {
    let tracks = matches!(pose.tracking_state(), Some(TrackingState::Tracking | TrackingState::Degenerate));
    let numbers = [pose.imu_position, pose.velocity, pose.gyro_bias, pose.accel_bias, pose.gravity];
    let turned = pose.imu_orientation.iter().map(|q| q * q).sum::<f64>();
    tracks && numbers.iter().flatten().all(|value| value.is_finite()) && (turned - 1.0).abs() < 1e-3
}

/// Metres and radians.
fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
}
