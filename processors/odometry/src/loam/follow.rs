//! As a standby; see [`crate::follow`].

use evac_frames::PoseFrame;
use evac_geometry::nalgebra::Isometry3;
use evac_geometry::{log_so3, map_from_imu};
use evac_stage::{Counters, ScanWithImu};

use super::filter::Filter;
use super::monitor::Monitor;
use super::stage::Loam;
use super::tracking::sweep;
use crate::follow::{Following, Standby};

/// Standard deviations of a followed state: velocity, m/s, and tilt, rad.
const SPEED: f64 = 0.1;
const TILT: f64 = 2e-3;

impl Standby for Loam {
    /// 3 s of the walk, as features are few.
    const WARM_FRAMES: u32 = 30;
    const AGREEING: (f64, f64) = (0.02, 0.0035);

    fn following(&mut self) -> &mut Following {
        &mut self.following
    }

    fn track(&mut self, input: &ScanWithImu<'_>, counters: &mut Counters) -> PoseFrame {
        self.pose_of(input, counters)
    }

    fn lay(&mut self, input: &ScanWithImu<'_>, routed: &PoseFrame, is_first: bool) {
        let Some(span) = self.advance(input, &mut Counters::default()) else { return };
        let end = map_from_imu(routed);
        let mut filter = Filter::new(input.header.frame.end_ns, &end, SPEED, TILT);
        let before = match self.filter.filter(|_| !is_first) {
            Some(before) => {
                filter.rate = log_so3(&(before.rotation.inverse() * end.rotation)) / span.h.max(1e-3);
                before
            }
            None => {
                self.clear_map();
                self.settling = None;
                self.monitor = Monitor::default();
                self.levelled = true;
                Filter { stamp_ns: input.header.frame.start_ns, ..filter }
            }
        };
        let step = (filter.position - before.position).norm();
        self.filter = Some(filter);
        self.take_over(routed);
        if let Some(filter) = self.filter {
            self.drift.count(&filter, step, false);
            self.map_scan(&filter, &sweep(input, &before));
        }
    }

    fn pose(&self) -> Option<Isometry3<f64>> {
        self.filter.map(|filter| filter.map_from_imu())
    }

    fn take_over(&mut self, routed: &PoseFrame) {
        let Some(filter) = &mut self.filter else { return };
        let end = map_from_imu(routed);
        (filter.position, filter.rotation) = (end.translation.vector, end.rotation);
        filter.velocity = routed.velocity.into();
        filter.gyro_bias = routed.gyro_bias.into();
        filter.accel_bias = routed.accel_bias.into();
    }
}
