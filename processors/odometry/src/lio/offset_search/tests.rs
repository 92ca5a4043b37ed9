use evac_geometry::exp_so3;

use super::*;

/// Angle about z of a walker's yaw, rad, and its rate.
fn sway(time_s: f64) -> (f64, f64) {
    (0.02 * (11.3 * time_s).sin() + 0.3 * time_s, 0.02 * 11.3 * (11.3 * time_s).cos() + 0.3)
}

/// Searches over `seconds` of a motion whose IMU stamps are `ahead_s` ahead of the LiDAR's clock.
fn search(ahead_s: f64, seconds: f64, rate_at: impl Fn(f64) -> (f64, f64)) -> (Found, u32) {
    let mut search = OffsetSearch::new();
    let mut next_imu = 0;
    for frame in 1..(seconds * 10.0) as i64 {
        let end_s = frame as f64 * 0.1;
        while next_imu as f64 * 0.005 <= end_s {
            let true_s = next_imu as f64 * 0.005;
            let stamp_ns = ((true_s + ahead_s) * 1e9) as i64;
            search.push_rate(stamp_ns, Vector3::new(0.0, 0.0, rate_at(true_s).1));
            next_imu += 1;
        }
        let attitude = Attitude {
            stamp_ns: frame * 100_000_000,
            map_from_imu: exp_so3(&Vector3::new(0.0, 0.0, rate_at(end_s).0)),
            covariance: Matrix3::identity() * 1e-7,
        };
        match search.push_attitude(attitude, 0.0, true) {
            Found::Searching => {}
            found => return (found, frame as u32),
        }
    }
    (Found::Searching, 0)
}

#[test]
fn an_offset_of_tens_of_milliseconds_is_found_to_a_millisecond() {
    for ahead_s in [-0.095, -0.08, -0.02, 0.02, 0.08, 0.1] {
        let (found, _) = search(ahead_s, 10.0, sway);
        let Found::Changed(offset_s) = found else { panic!("{ahead_s}: {found:?}") };
        assert!((offset_s + ahead_s).abs() < 1e-3, "{ahead_s}: {offset_s}");
    }
}

#[test]
fn clocks_that_agree_are_left_alone() {
    assert_eq!(search(0.0, 10.0, sway).0, Found::Settled);
    assert_eq!(search(0.004, 10.0, sway).0, Found::Settled);
}

#[test]
fn changes_that_shrink_are_gone_on_with_to_where_they_would_end() {
    let mut search = OffsetSearch::new();
    assert_eq!(search.extrapolated(0.0, 0.04), 0.04);
    // Half of what is left each time: 40 of 80 ms, then 20 of 40.
    search.last_change = Some((0.0, 0.04));
    assert!((search.extrapolated(0.04, 0.02) - 0.08).abs() < 1e-12);
    // A change back, or one as large as the last, begins anew; no offset beyond the search's range.
    assert_eq!(search.extrapolated(0.04, -0.02), 0.02);
    assert_eq!(search.extrapolated(0.04, 0.04), 0.08);
    search.last_change = Some((0.0, 0.05));
    assert!((search.extrapolated(0.05, 0.04) - 0.12).abs() < 1e-12);
}

#[test]
fn a_steady_turn_says_nothing_about_the_offset() {
    let (found, frame) = search(0.05, 12.0, |time_s| (0.3 * time_s, 0.3));
    assert_eq!(found, Found::Settled);
    assert!(frame >= MAX_ROTATIONS);
}
