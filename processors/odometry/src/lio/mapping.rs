//! What becomes of a match: it is judged, and the scan is mapped, or not.

use evac_frames::TrackingState;

use super::correction::Report;
use super::filter::{Filter, position_sigma};
use super::monitor::{ADRIFT, Expected, Verdict};
use super::settling::{Scratch, Settling};
use super::stage::{Lio, insert_all};
use super::state::{Covariance, State};

/// A pose less certain than this is no place to lay new ground from as if it were exact, metres. Below it the drift of new ground is
/// counted ([`super::drift`]); from 5 mm on, halls were begun and returned to in every other frame.
const SECTION_SIGMA: f64 = 0.01;
/// ... if a tenth of the scan sees new ground, or less of it from a pose that is less certain: the share times that, metres.
const NEW_GROUND: f64 = 0.001;
/// One point in so many tells how far a scan sees.
const RANGE_STRIDE: usize = 8;
/// Scans farther apart than this have others missing between them, seconds.
const MAX_STEP_S: f64 = 0.25;
/// Frames within which the pose is back in an older section.
const RETURNING_FRAMES: u32 = 3;
/// Most scans that are not mapped while the clocks' offset is searched for, and the share of a scan that must see the
/// standstill's map meanwhile.
const MAX_WITHHELD: u32 = 45;
const STANDSTILL_SHARE: f64 = 0.8;
/// A scan of which so much sees known ground ...
const KNOWN_SHARE: f64 = 0.5;
/// ... is not mapped from an orientation less certain than this, rad (standard deviation): half a degree.
const MAX_ROTATION_SIGMA: f64 = 0.0087;

impl Lio {
    /// Judges the match and maps the scan if it was good; `predicted` is the filter before the match.
    pub(crate) fn judge(
        &mut self,
        filter: &mut Filter,
        report: &Report,
        before: &State,
        predicted: &(State, Covariance),
        gap_s: f64,
    ) -> TrackingState {
        let degenerate = filter.degeneracy.count > 0;
        let ranges = self.points.iter().step_by(RANGE_STRIDE).map(|point| point.norm());
        let expected = Expected {
            degenerate,
            returning: filter.returning > 0,
            after_gap: gap_s > MAX_STEP_S,
            position_sigma: position_sigma(&filter.covariance),
            is_blank: filter.degeneracy.count > 1,
            is_adrift: position_sigma(&predicted.1) > ADRIFT,
            range_m: ranges.sum::<f64>() / self.points.len().div_ceil(RANGE_STRIDE).max(1) as f64,
        };
        filter.returning = filter.returning.saturating_sub(1);
        let verdict = filter.monitor.judge(report, expected, &filter.state, &self.config);
        self.diagnostics.nis = filter.monitor.nis();
        match verdict {
            Verdict::Good | Verdict::Doubtful => {
                if verdict == Verdict::Good {
                    self.map_scan(filter, report);
                } else if expected.is_adrift {
                    // Far from where it is, whatever is near agrees with it.
                    (filter.state, filter.covariance) = *predicted;
                }
                return match (expected.position_sigma > ADRIFT, degenerate) {
                    (true, _) => TrackingState::Lost,
                    (false, true) => TrackingState::Degenerate,
                    (false, false) => TrackingState::Tracking,
                };
            }
            Verdict::Adrift => {
                // What the IMU says of the motion is still the best there is.
                self.diagnostics.losses += 1;
                self.diagnostics.map_restarts += 1;
                (filter.state, filter.covariance) = *predicted;
                filter.observe(&Report::default());
                filter.sections.begin(&mut filter.state, &mut filter.covariance);
                self.map.clear();
                self.map.next_frame(filter.sections.current(), filter.sections.drift.current());
                self.insert_scan(filter);
            }
            Verdict::Blocked => {
                (filter.state, filter.covariance) = *predicted;
                filter.observe(&Report::default());
                return TrackingState::Degenerate;
            }
            Verdict::JustLost => {
                // The correction that gave it away is not trusted.
                self.diagnostics.losses += 1;
                filter.state = predicted.0;
                filter.loosen();
            }
            // What is not observed now rests on the IMU, which need not be at fault.
            Verdict::Lost if degenerate => {}
            Verdict::Lost => filter.loosen(),
            Verdict::Restart => {
                self.diagnostics.map_restarts += 1;
                filter.restart();
                self.map.clear();
            }
        }
        filter.hold_speed(before, &self.config);
        TrackingState::Lost
    }

    /// Adds the scan to the map, unless it would spoil it.
    fn map_scan(&mut self, filter: &mut Filter, report: &Report) {
        let view = report.in_view as f64 / report.selected.max(1) as f64;
        // While the clocks' offset is not known scans may be smeared: the standstill's map stays as it is while it is seen.
        if !self.offset_search.is_plausible() && filter.withheld < MAX_WITHHELD && view > STANDSTILL_SHARE {
            filter.withheld += 1;
            return;
        }
        // Known ground gains nothing from a scan that may lie across it.
        if view > KNOWN_SHARE && filter.rotation_sigma() > MAX_ROTATION_SIGMA {
            return;
        }
        let unseen = (report.selected - report.known) as f64 / report.selected.max(1) as f64;
        filter.sections.lay(unseen, &filter.state, &filter.covariance);
        self.choose_section(filter, report, unseen);
        self.map.next_frame(filter.sections.current(), filter.sections.drift.current());
        self.insert_scan(filter);
    }

    /// Whether the scan goes into the section that the pose is in, into a new one or back into an old one.
    fn choose_section(&mut self, filter: &mut Filter, report: &Report, unseen: f64) {
        if let Some(id) = report.anchor {
            filter.sections.return_to(id, &mut filter.state, &mut filter.covariance);
            filter.returning = RETURNING_FRAMES;
            self.diagnostics.sections_returned_to += 1;
            return;
        }
        let sigma = position_sigma(&filter.covariance);
        if sigma > SECTION_SIGMA && unseen * sigma > NEW_GROUND {
            filter.sections.begin(&mut filter.state, &mut filter.covariance);
            self.diagnostics.sections_begun += 1;
        }
    }

    /// One frame of scan-to-scan tracking.
    pub(crate) fn settle(
        &mut self,
        filter: &mut Filter,
        settling: Settling,
        before: &State,
    ) -> TrackingState {
        filter.hold_speed(before, &self.config);
        self.map.next_frame(filter.sections.current(), filter.sections.drift.current());
        let scratch = settling.step(filter);
        if scratch != Scratch::Extend {
            self.map.clear();
        }
        if scratch == Scratch::Done {
            if settling.starting {
                filter.rebase(&self.imu_from_lidar);
                self.forget_start();
            }
            filter.observe(&Report::default());
            return TrackingState::Degenerate;
        }
        self.insert_scan(filter);
        if settling.starting { TrackingState::Initialising } else { TrackingState::Lost }
    }

    fn insert_scan(&mut self, filter: &Filter) {
        let map_from_lidar = filter.state.map_from_imu() * self.imu_from_lidar;
        insert_all(
            &mut self.map,
            &map_from_lidar,
            self.points.iter().copied(),
            filter.sections.to_frames(&filter.state),
        );
    }
}
