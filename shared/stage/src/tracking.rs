//! How an odometry fares, counted from the poses that it publishes.

use evac_frames::{OdometryHealth, PoseFrame, TrackingState};

/// Takes a published pose into the account.
pub(crate) fn count(health: &mut OdometryHealth, pose: &PoseFrame) {
    let was_lost = health.state == TrackingState::Lost as u32;
    let is = |state: TrackingState| pose.state == state as u32;
    let started = !is(TrackingState::Initialising);
    health.poses += u64::from(started);
    health.degenerate += u64::from(started && pose.degenerate > 0);
    health.lost += u64::from(is(TrackingState::Lost));
    health.losses += u64::from(is(TrackingState::Lost) && !was_lost);
    health.state = pose.state;
    health.directions = pose.degenerate;
    health.quality = pose.quality;
    health.time_offset_ns = pose.time_offset_ns;
    health.time_offset_sigma_us = pose.time_offset_sigma_us;
    health.gyro_bias = pose.gyro_bias;
    health.accel_bias = pose.accel_bias;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_of_three_frames_is_one_loss_and_the_wait_before_the_start_is_none() {
        let mut health = OdometryHealth::default();
        let states = [
            (TrackingState::Initialising, 0),
            (TrackingState::Tracking, 0),
            (TrackingState::Degenerate, 2),
            (TrackingState::Lost, 1),
            (TrackingState::Lost, 0),
            (TrackingState::Lost, 0),
            (TrackingState::Tracking, 0),
            (TrackingState::Lost, 0),
        ];
        for (state, degenerate) in states {
            let pose = PoseFrame { state: state as u32, degenerate, quality: 0.5, ..PoseFrame::default() };
            count(&mut health, &pose);
        }
        assert_eq!((health.poses, health.degenerate), (7, 2));
        assert_eq!((health.lost, health.losses), (4, 2));
        assert_eq!((health.state, health.quality), (TrackingState::Lost as u32, 0.5));
    }
}
