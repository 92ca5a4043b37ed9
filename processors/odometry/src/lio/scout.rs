//! The scout: while the offset between the clocks is searched for, each scan is also matched by itself, and what the LiDAR turned by
//! is compared with what the gyroscope says ([`super::offset_search`]).

use evac_frames::FrameHeader;
use evac_geometry::nalgebra::{Matrix3, UnitQuaternion};

use super::correction::{Gate, Report, correct};
use super::deskew::Middle;
use super::filter::Filter;
use super::matching::Known;
use super::offset_search::{Attitude, Found};
use super::stage::Lio;
use super::state::{Covariance, State, add_variance, at, copy_places};
use super::tracking::middle_ns;

/// Added to the gates of the associations, metres: so wide that what a wrong clock has displaced still counts.
const GATE: &[f64] = &[0.2, 0.06];
/// A scan fits the map if the filter can use so much of what it sees.
const FITTING_SHARE: f64 = 0.6;
/// What the scout is not told by the IMU, rad and m.
const FREE_ROTATION: f64 = 0.035;
const FREE_POSITION: f64 = 0.1;
/// A scan that leaves the scout less certain than this says too little, rad and m (standard deviations).
const KNOWS_ROTATION: f64 = 1.5e-3;
const KNOWS_POSITION: f64 = 0.02;
/// A filter this far from the scout has gone astray, m and rad.
const ASTRAY_POSITION: f64 = 0.1;
const ASTRAY_ROTATION: f64 = 0.012;

/// The pose that the LiDAR alone gives, with the covariance of its error (rotation: IMU frame).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scout {
    state: State,
    /// `map_from_imu` rotation in the middle of the scan.
    pub(crate) at_middle: UnitQuaternion<f64>,
    pub(crate) rotation: Matrix3<f64>,
    position: Matrix3<f64>,
}

impl Scout {
    /// Whether it knows all six directions.
    fn is_sure(&self) -> bool {
        let largest = |covariance: &Matrix3<f64>| covariance.symmetric_eigenvalues().max().sqrt();
        largest(&self.rotation) < KNOWS_ROTATION && largest(&self.position) < KNOWS_POSITION
    }
}

impl Lio {
    /// While the clocks' offset is searched for: the pose that the LiDAR alone gives.
    pub(crate) fn scout(&mut self, filter: &Filter, middle: &Middle) -> Option<Scout> {
        if self.offset_search.is_over() || filter.settling.is_some() {
            return None;
        }
        let scout = self.match_alone(filter, middle, GATE);
        if scout.is_none() {
            self.offset_search.interrupt();
        }
        scout
    }

    /// Matches the selected points with the map, the IMU only saying where to begin; `None` where most of them fit nothing.
    /// `floors` as in [`Gate`].
    pub(crate) fn match_alone(
        &mut self,
        filter: &Filter,
        middle: &Middle,
        floors: &'static [f64],
    ) -> Option<Scout> {
        let mut state = filter.state;
        let mut covariance = Covariance::zeros();
        add_variance(&mut covariance, at::ROTATION, FREE_ROTATION.powi(2));
        add_variance(&mut covariance, at::POSITION, FREE_POSITION.powi(2));
        copy_places(&filter.covariance, &mut covariance);
        let report = correct(
            &Known { map: &self.map, sections: &filter.sections },
            &self.selected,
            &mut state,
            &mut covariance,
            &middle.twist,
            &Gate { range_noise: self.config.range_noise_m, floors, doubts_walls: false, always_false: 0.0 },
            &mut self.matches,
        );
        (report.used * 2 > report.selected && state.is_finite()).then(|| Scout {
            state,
            at_middle: state.rotation * middle.from_end.inverse(),
            rotation: covariance.fixed_view::<3, 3>(at::ROTATION, at::ROTATION).into_owned(),
            position: covariance.fixed_view::<3, 3>(at::POSITION, at::POSITION).into_owned(),
        })
    }

    /// Compares what the LiDAR turned by with the gyroscope; a filter that has followed a wrong clock takes the scout's pose. An offset that
    /// the way is to be taken again with is returned as it was found.
    pub(crate) fn search_offset(
        &mut self,
        filter: &mut Filter,
        scout: &Scout,
        report: &Report,
        frame: &FrameHeader,
    ) -> Found {
        let fits = report.used as f64 > FITTING_SHARE * report.in_view as f64;
        let attitude = Attitude {
            stamp_ns: middle_ns(frame),
            map_from_imu: scout.at_middle,
            covariance: scout.rotation,
        };
        let found = self.offset_search.push_attitude(attitude, filter.state.time_offset_s, fits);
        if self.retake.is_possible() && matches!(found, Found::Changed(_)) {
            return found;
        }
        let astray = (scout.state.position - filter.state.position).norm() > ASTRAY_POSITION
            || scout.state.rotation.angle_to(&filter.state.rotation) > ASTRAY_ROTATION;
        if scout.is_sure() && (astray || matches!(found, Found::Changed(_))) {
            filter.state.rotation = scout.state.rotation;
            filter.state.position = scout.state.position;
            filter.loosen();
        }
        if let Found::Changed(offset_s) = found {
            self.diagnostics.offset_corrections += 1;
            filter.correct_offset(offset_s, frame.end_ns);
        }
        found
    }
}
