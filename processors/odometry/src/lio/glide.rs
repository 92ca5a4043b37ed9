//! Whether a rig whose IMU is at rest stands or glides: an IMU cannot tell, scans can.

use evac_geometry::nalgebra::Vector3;
use evac_stage::ScanWithImu;

use super::correction::{Gate, correct};
use super::deskew::Twist;
use super::initialisation::Start;
use super::matching::{Known, select};
use super::sections::Sections;
use super::stage::{Lio, MAX_SELECTED, insert_all, valid};
use super::state::{Covariance, add_variance, at};

/// Points at the beginning of the standstill that are compared with its last scan: two scans of a Mid-40, which a glide does not yet
/// blur beyond recognition.
const FIRST_POINTS: usize = 20_000;
/// Added to the gates of the associations, metres: over a second's walk.
const GATE: &[f64] = &[0.5, 0.3, 0.2, 0.1, 0.05, 0.02];
/// Displacement between the first scans and the last that may be, metres (standard deviation before the match).
const FREE_POSITION: f64 = 0.5;
/// A displacement beyond this is no standstill, metres, if it is so many standard deviations, squared.
const MOVED: f64 = 0.1;
const SURE_SQUARED: f64 = 0.5;

/// Of a scan from the same place at least so much fits; 91 % and more do in halls with people in them, 84 % where the clocks are 80 ms apart and
/// the scan shows the onset of the motion that the IMU does not show yet.
const FITTING_SHARE: f64 = 0.8;

impl Lio {
    /// Whether the last scan of the standstill lies elsewhere than its first ones. Leaves the map empty.
    pub(crate) fn has_moved(&mut self, input: &ScanWithImu<'_>, start: &Start) -> bool {
        let map_from_lidar = start.state.map_from_imu() * self.imu_from_lidar;
        let first = self.still.iter().take(FIRST_POINTS).map(|point| point.cast());
        insert_all(&mut self.map, &map_from_lidar, first, |_, point| *point);
        let stride = input.points.len().div_ceil(MAX_SELECTED).max(self.config.point_stride as usize);
        let points = input.points.iter().filter_map(|point| valid(point, &self.config)).step_by(stride);
        self.selected.clear();
        self.selected.extend(points.map(|point| select(&self.imu_from_lidar, &point)));
        let mut state = start.state;
        let mut covariance = Covariance::zeros();
        add_variance(&mut covariance, at::POSITION, FREE_POSITION.powi(2));
        let sections = self.sections.take().unwrap_or_else(Sections::new);
        let report = correct(
            &Known { map: &self.map, sections: &sections },
            &self.selected,
            &mut state,
            &mut covariance,
            &Twist::default(),
            &Gate {
                range_noise: self.config.range_noise_m,
                floors: GATE,
                doubts_walls: false,
                always_false: 0.0,
            },
            &mut self.matches,
        );
        self.sections = Some(sections);
        self.map.clear();
        let way: Vector3<f64> = state.position - start.state.position;
        let certainty = way.dot(&(report.position_information * way));
        let fits = report.used as f64 >= FITTING_SHARE * report.in_view as f64;
        !fits || way.norm() > MOVED && certainty > SURE_SQUARED
    }
}
