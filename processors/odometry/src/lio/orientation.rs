//! The orientation of each scan by the LiDAR alone, for calibration: compared with what the gyroscope turned by, it shows
//! how the IMU really sits, reads and keeps time.

use evac_frames::FrameHeader;
use evac_geometry::nalgebra::{Matrix3, UnitQuaternion};

use super::deskew::Middle;
use super::filter::Filter;
use super::stage::Lio;
use super::tracking::middle_ns;

/// Added to the gates of the associations, metres: narrower than the scout's, as the calibration comes back with a better clock.
const GATE: &[f64] = &[0.1, 0.03];

/// Orientation of one scan, matched with the map without the IMU.
#[derive(Debug, Clone, Copy)]
pub struct ScanOrientation {
    /// Middle of the scan by the LiDAR's clock, nanoseconds; the orientation holds there: what an IMU with the wrong time does to the
    /// scan on the way to its end does not show in the middle, to first order.
    pub stamp_ns: i64,
    /// `map_from_imu` rotation, the IMU frame being that of the rig's configuration.
    pub map_from_imu: UnitQuaternion<f64>,
    /// Covariance of its right error, rad^2, IMU frame: as large as 2 degrees where the scan does not show it.
    pub covariance: Matrix3<f64>,
    /// Changes where the map has changed its frame: orientations of two maps are not to be compared.
    pub map: u64,
}

impl Lio {
    /// Also matches every scan by itself from now on; costs about as much as the odometry's own match.
    pub fn orient_scans(&mut self) {
        self.orients_scans = true;
    }

    /// Orientation of the newest scan, if [`Self::orient_scans`] was asked for and the scan fits the map.
    pub fn scan_orientation(&self) -> Option<&ScanOrientation> {
        self.orientation.as_ref()
    }

    /// Matches the selected points with the map as it was before them; a scan that the IMU does not cover says nothing about it.
    pub(crate) fn orient(&mut self, filter: &Filter, middle: &Middle, frame: &FrameHeader, is_led: bool) {
        self.orientation = None;
        if !self.orients_scans || filter.is_loose() || is_led {
            return;
        }
        let diagnostics = &self.diagnostics;
        let map = diagnostics.map_restarts
            + diagnostics.losses
            + diagnostics.sections_returned_to
            + diagnostics.offset_corrections;
        self.orientation = self.match_alone(filter, middle, GATE).map(|scout| ScanOrientation {
            stamp_ns: middle_ns(frame),
            map_from_imu: scout.at_middle,
            covariance: scout.rotation,
            map,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::LioConfig;
    use super::super::initialisation::Start;
    use super::super::sections::Sections;
    use super::super::state::{Covariance, State};
    use evac_geometry::nalgebra::Vector3;

    use super::*;

    #[test]
    fn a_filter_begins_with_the_clock_and_the_scale_of_its_calibration() {
        let config =
            LioConfig { time_offset_ms: 12.0, gyro_scale: [0.004, 0.0, -0.002], ..LioConfig::default() };
        let start = Start {
            state: State::at_origin(),
            covariance: Covariance::zeros(),
            accel_noise: 0.0,
            gyro_noise: 0.0,
            standing: true,
        };
        let filter = Filter::new(&start, 1_000_000_000, &config, Sections::new());
        // The frame's end by the IMU's clock.
        assert_eq!(filter.stamp_ns, 988_000_000);
        assert_eq!(filter.state.offset_ns(), 12_000_000);
        // A reading of 1.004 rad/s is a rate of 1 rad/s.
        let rate = filter.state.rate_of(&Vector3::new(1.004, 0.0, 0.0));
        assert!((rate.x - 1.0).abs() < 2e-5, "{rate}");
    }
}
