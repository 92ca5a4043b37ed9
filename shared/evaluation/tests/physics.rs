//! What the figures say about motions whose error is known.
#![allow(clippy::unwrap_used)]

use evac_evaluation::{Evaluation, EvaluationError, Pairs, Side, associate, associate_absolute};
use evac_formats::tum::TumPose;
use evac_geometry::nalgebra::{Isometry3, Vector3};

const FRAME_NS: i64 = 100_000_000;

/// `n` frames of 0.1 s and 0.1 m along x.
fn straight(n: usize) -> Vec<Isometry3<f64>> {
    (0..n).map(|i| Isometry3::translation(i as f64 * 0.1, 0.0, 0.0)).collect()
}

/// A square of 4 x 10 m, one pose a metre.
fn square() -> Vec<Isometry3<f64>> {
    let corner = |i: u32| match i / 10 {
        0 => (f64::from(i), 0.0),
        1 => (10.0, f64::from(i - 10)),
        2 => (f64::from(30 - i), 10.0),
        _ => (0.0, f64::from(40 - i)),
    };
    (0..=40).map(|i| Isometry3::translation(corner(i).0, corner(i).1, 0.0)).collect()
}

/// A map frame that is turned and shifted.
fn map() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(5.0, -2.0, 1.0), Vector3::new(0.1, 0.2, 1.5))
}

fn pairs(truth: &[Isometry3<f64>], estimate: &[Isometry3<f64>]) -> Pairs {
    let stamps: Vec<_> = (0..truth.len() as i64).map(|i| i * FRAME_NS).collect();
    Pairs::from_poses(&stamps, truth, estimate).unwrap()
}

fn evaluate(truth: &[Isometry3<f64>], estimate: &[Isometry3<f64>]) -> Evaluation {
    Evaluation::of(&pairs(truth, estimate)).unwrap()
}

fn tum(start_ns: i64, interval_ns: i64, poses: &[Isometry3<f64>]) -> Vec<TumPose> {
    let pose = |(i, pose): (i64, &Isometry3<f64>)| TumPose {
        stamp_ns: start_ns + i * interval_ns,
        position: pose.translation.vector.into(),
        orientation: pose.rotation.coords.into(),
    };
    (0..).zip(poses).map(pose).collect()
}

#[test]
fn a_copy_seen_from_another_map_frame_has_no_error() {
    let truth = square();
    let estimate: Vec<_> = truth.iter().map(|pose| map() * pose).collect();
    let figures = evaluate(&truth, &estimate);
    assert_eq!(figures.frames, 41);
    assert!((figures.path_m - 40.0).abs() < 1e-9);
    for error in [figures.ape_se3.max, figures.ape_first.max, figures.end_m, figures.z_error_figures.range] {
        assert!(error < 1e-9, "{figures:?}");
    }
    assert!(figures.rotation_se3_deg.max < 1e-6 && figures.end_rotation_deg < 1e-6, "{figures:?}");
}

#[test]
fn a_yaw_error_of_one_degree_at_the_start_bends_nothing_and_misses_the_end_by_its_chord() {
    let truth = straight(501);
    // The walk is right; only the first orientation, from which the estimate's map frame follows, is one degree off.
    let yaw = Isometry3::rotation(Vector3::z() * 1f64.to_radians());
    let mut estimate = truth.clone();
    estimate[0] *= yaw;
    let figures = evaluate(&truth, &estimate);
    assert!(figures.ape_se3.max < 1e-9, "{figures:?}");
    let chord = 2.0 * (0.5_f64).to_radians().sin() * 50.0;
    assert!((figures.ape_first.max - chord).abs() < 1e-9, "{figures:?}");
    // sin(1 degree) L across the path, and almost nothing along it.
    assert!((figures.end_m - 1f64.to_radians().sin() * 50.0).abs() < 1e-4 * 50.0, "{figures:?}");
    assert!((figures.end_rotation_deg - 1.0).abs() < 1e-9, "{figures:?}");
    assert!((figures.end_percent - 1.745).abs() < 1e-3, "{figures:?}");
}

#[test]
fn a_straight_path_one_percent_too_long_errs_by_a_centimetre_a_metre() {
    let truth = straight(201);
    let estimate: Vec<_> =
        truth.iter().map(|pose| Isometry3::translation(pose.translation.x * 1.01, 0.0, 0.0)).collect();
    let figures = evaluate(&truth, &estimate);
    let per_metre = figures.rpe_1m.unwrap();
    assert_eq!(per_metre.pairs, 191);
    assert!((per_metre.translation_m.rmse - 0.01).abs() < 1e-9, "{per_metre:?}");
    assert!((per_metre.translation_m.max - 0.01).abs() < 1e-9, "{per_metre:?}");
    assert!(per_metre.rotation_deg.max < 1e-9, "{per_metre:?}");
    // At 1 m/s a metre is a second.
    assert!((figures.rpe_1s.unwrap().translation_m.median - 0.01).abs() < 1e-9);
    assert!((figures.end_percent - 1.0).abs() < 1e-9);
}

#[test]
fn about_a_straight_path_the_first_poses_say_which_way_is_up() {
    let truth = straight(100);
    let estimate: Vec<_> = truth.iter().map(|pose| map() * pose).collect();
    assert!(evaluate(&truth, &estimate).rotation_se3_deg.max < 1e-4);
}

#[test]
fn a_rig_that_stands_has_no_metre_but_seconds() {
    let truth = vec![Isometry3::identity(); 50];
    let estimate: Vec<_> = truth.iter().map(|pose| map() * pose).collect();
    let figures = evaluate(&truth, &estimate);
    assert_eq!((figures.rpe_1m, figures.end_percent, figures.path_m), (None, 0.0, 0.0));
    assert!(figures.rpe_1s.unwrap().translation_m.max < 1e-9 && figures.ape_se3.max < 1e-9);
}

#[test]
fn one_jump_shows_in_the_pairs_that_span_it_only() {
    let truth = straight(101);
    let mut estimate = truth.clone();
    estimate[50..].iter_mut().for_each(|pose| pose.translation.y += 0.3);
    let per_second = evaluate(&truth, &estimate).rpe_1s.unwrap();
    assert_eq!(per_second.pairs, 91);
    assert!((per_second.translation_m.max - 0.3).abs() < 1e-9 && per_second.translation_m.median < 1e-9);
    // 10 of 91 pairs span it.
    assert!((per_second.translation_m.mean - 0.3 * 10.0 / 91.0).abs() < 1e-9, "{per_second:?}");
}

#[test]
fn heights_count_from_the_start_and_their_errors_from_the_truth() {
    // A ramp of 1 m in 10 m, from a floor at 7 m; the estimate climbs 2 cm too much.
    let ramp = |rise: f64| -> Vec<_> {
        (0..=100)
            .map(|i| Isometry3::translation(f64::from(i) * 0.1, 0.0, 7.0 + f64::from(i) * 0.01 * rise))
            .collect()
    };
    let figures = evaluate(&ramp(1.0), &ramp(1.02));
    assert!(figures.z_figures.minimum.abs() < 1e-9 && (figures.z_figures.maximum - 1.02).abs() < 1e-9);
    assert!((figures.z_error_figures.range - 0.02).abs() < 1e-9);
    assert!((figures.z_error_figures.average - 0.01).abs() < 1e-9);
    assert_eq!(figures.z_figures.number, 101);
}

#[test]
fn clocks_may_differ_by_a_constant() {
    let walk = straight(100);
    let pairs =
        associate(&tum(1_700_000_000_000_000_000, FRAME_NS, &walk), &tum(12_345, FRAME_NS, &walk)).unwrap();
    assert_eq!((pairs.len(), pairs.without_truth()), (100, 0));
    assert_eq!(pairs.offset_ns(), 1_700_000_000_000_000_000 - 12_345);
    assert_eq!(pairs.stamps_ns()[0], 12_345);
    assert!(Evaluation::of(&pairs).unwrap().ape_first.max < 1e-9);
}

#[test]
fn a_truth_sparser_than_the_estimate_is_interpolated() {
    let walk = straight(101);
    let sparse: Vec<_> = walk.iter().step_by(7).copied().collect();
    let pairs = associate(&tum(0, 7 * FRAME_NS, &sparse), &tum(0, FRAME_NS, &walk)).unwrap();
    // The truth ends at frame 98.
    assert_eq!((pairs.len(), pairs.without_truth()), (99, 2));
    assert!(Evaluation::of(&pairs).unwrap().ape_first.max < 1e-9);
}

#[test]
fn nothing_is_said_where_the_truth_has_a_gap() {
    let walk = straight(101);
    let (truth, estimate) = (tum(0, FRAME_NS, &walk), tum(0, FRAME_NS, &walk));
    let with_gap: Vec<_> =
        truth.iter().filter(|pose| !(41..60).contains(&(pose.stamp_ns / FRAME_NS))).copied().collect();
    let pairs = associate(&with_gap, &estimate).unwrap();
    assert_eq!((pairs.len(), pairs.without_truth()), (82, 19));
}

#[test]
fn stamps_rounded_to_microseconds_lose_no_frame() {
    let walk = straight(20);
    let estimate: Vec<_> = tum(0, FRAME_NS, &walk)
        .into_iter()
        .map(|pose| TumPose { stamp_ns: pose.stamp_ns + if pose.stamp_ns == 0 { 0 } else { 900 }, ..pose })
        .collect();
    assert_eq!(associate(&tum(0, FRAME_NS, &walk), &estimate).unwrap().len(), 20);
}

#[test]
fn on_one_clock_an_estimate_may_begin_later() {
    let walk = straight(100);
    let truth = tum(5_000_000_000, FRAME_NS, &walk);
    let estimate = &truth[30..];
    let pairs = associate_absolute(&truth, estimate).unwrap();
    assert_eq!((pairs.len(), pairs.offset_ns()), (70, 0));
    assert!(Evaluation::of(&pairs).unwrap().end_m < 1e-9);
    // Counted from the first poses the same two are 3 s apart, which a straight line at constant speed hides; the corner of
    // a square does not.
    let truth = tum(0, FRAME_NS, &square());
    let wrong = Evaluation::of(&associate(&truth, &truth[5..]).unwrap()).unwrap();
    assert!(wrong.ape_first.max > 1.0, "{wrong:?}");
}

#[test]
fn what_cannot_be_compared_is_refused_with_its_cause() {
    let walk = tum(0, FRAME_NS, &straight(10));
    assert_eq!(associate(&[], &walk), Err(EvaluationError::TooFew { side: Side::Truth, poses: 0 }));
    assert_eq!(associate(&walk, &walk[..1]), Err(EvaluationError::TooFew { side: Side::Estimate, poses: 1 }));
    let mut back = walk.clone();
    back.swap(3, 4);
    let error = associate(&walk, &back).unwrap_err().to_string();
    assert!(error.contains("the estimate: pose 5 is stamped 0.300000000 s"), "{error}");
    let mut twice = walk.clone();
    twice[7].stamp_ns = twice[6].stamp_ns;
    assert!(matches!(
        associate(&twice, &walk),
        Err(EvaluationError::NotMonotonic { side: Side::Truth, pose: 8, .. })
    ));
    let later = tum(2_000_000_000, FRAME_NS, &straight(10));
    let error = associate_absolute(&walk, &later).unwrap_err().to_string();
    assert!(error.contains("0.900000000 s") && error.contains("0 of its poses"), "{error}");
    let mut infinite = walk.clone();
    infinite[2].position[1] = f64::NAN;
    assert_eq!(
        associate(&walk, &infinite),
        Err(EvaluationError::NotFinite { side: Side::Estimate, pose: 3 })
    );
    let truth = tum(0, 5_000_000_000, &straight(10));
    let error = associate(&truth, &tum(1, 1_300_000_000, &straight(3))[..2]).unwrap_err().to_string();
    assert!(error.contains("9 gaps of over 1 s") && error.contains("1 of its poses"), "{error}");
}

#[test]
fn poses_of_a_run_need_one_stamp_each() {
    let walk = straight(3);
    let error = Pairs::from_poses(&[0, 1], &walk, &walk).unwrap_err();
    assert_eq!(error, EvaluationError::Lengths { stamps: 2, truth: 3, estimate: 3 });
    assert_eq!(Evaluation::of(&pairs(&walk[..1], &walk[..1])), None);
    assert_eq!(Evaluation::of(&pairs(&[], &[])), None);
}
