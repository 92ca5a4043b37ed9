//! The walk, its IMU and its truth.

// Clippy's exception for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use evac_frames::{ImuSample, frame_flags};
use evac_geometry::nalgebra::{Isometry3, Vector3};
use evac_geometry::{STANDARD_GRAVITY, exp_so3, log_so3, map_from_imu, map_from_lidar};
use evac_simulator::{Config, Frame, SAMPLE_NS, Simulator, WorldKind, simulate};
use evac_stage::{Rig, SensorEvent, Source as _};

fn ideal_imu() -> Config {
    Config {
        gyro_noise_dps: 0.0,
        accel_noise_m_s2: 0.0,
        gyro_bias_dps: 0.0,
        accel_bias_m_s2: 0.0,
        auto_zero: false,
        seed: 4,
        ..Config::default()
    }
}

fn imu(config: &Config, seconds: f64) -> Vec<ImuSample> {
    let frames = simulate(&Config { duration_s: Some(seconds), ..config.clone() }, &Rig::default()).unwrap();
    let mut samples: Vec<ImuSample> = frames.flat_map(|frame| frame.imu).collect();
    samples.dedup_by_key(|sample| sample.seq);
    samples
}

fn mean(samples: &[ImuSample], of: impl Fn(&ImuSample) -> [f64; 3]) -> Vector3<f64> {
    samples.iter().map(|sample| Vector3::from(of(sample))).sum::<Vector3<f64>>() / samples.len() as f64
}

#[test]
fn samples_are_five_milliseconds_apart_and_each_frame_is_covered_from_border_to_border() {
    let config = Config { duration_s: Some(1.0), seed: 2, ..Config::default() };
    for frame in simulate(&config, &Rig::default()).unwrap() {
        assert_eq!(frame.imu.len(), 21);
        assert_eq!(frame.imu.first().unwrap().stamp_ns, frame.header.frame.start_ns);
        assert_eq!(frame.imu.last().unwrap().stamp_ns, frame.header.frame.end_ns);
        assert!(frame.imu.windows(2).all(|pair| pair[1].stamp_ns - pair[0].stamp_ns == SAMPLE_NS));
    }
}

#[test]
fn at_rest_the_imu_feels_gravity_upwards_and_the_zeroed_gyro_nothing_at_all() {
    let config = Config { mount_tilt_deg: [0.0; 2], accel_bias_m_s2: 0.0, seed: 6, ..Config::default() };
    let samples = imu(&config, 2.9);
    assert!(samples.iter().all(|sample| sample.gyro == [0.0; 3]));
    let up = mean(&samples, |sample| sample.accel);
    assert!((up - Vector3::z() * STANDARD_GRAVITY).norm() < 0.005, "{up:?}");
}

#[test]
fn without_auto_zero_the_gyro_shows_its_bias_and_its_noise_at_rest() {
    let config = Config { auto_zero: false, seed: 6, ..Config::default() };
    let samples = imu(&config, 2.9);
    let truth = simulate(&config, &Rig::default()).unwrap().next().unwrap().truth;
    let bias = mean(&samples, |sample| sample.gyro);
    let off = (bias - Vector3::from(truth.gyro_bias)).norm().to_degrees();
    assert!(off < 0.02, "mean is {off} degrees/s from the bias");
    assert!(bias.norm().to_degrees() > 0.05, "this seed has hardly any bias: {bias:?}");
    let square = mean(&samples, |s| [0, 1, 2].map(|i| (s.gyro[i] - bias[i]).powi(2))).sum() / 3.0;
    // One bit is 0.061 degrees/s; rounding adds a twelfth of its square.
    let expected = (0.08_f64.powi(2) + 0.061_f64.powi(2) / 12.0).sqrt();
    assert!((square.sqrt().to_degrees() - expected).abs() < 0.005, "{}", square.sqrt().to_degrees());
}

#[test]
fn auto_zero_hides_the_slow_start_of_a_motion_and_nothing_once_it_moves() {
    let quiet =
        Config { accel_noise_m_s2: 0.0, gyro_noise_dps: 0.0, gyro_bias_dps: 0.0, ..Config::default() };
    let zeroed = imu(&quiet, 8.0);
    let open = imu(&Config { auto_zero: false, ..quiet }, 8.0);
    let rate = |sample: &ImuSample| Vector3::from(sample.gyro).amax().to_degrees();
    let first = zeroed.iter().position(|sample| rate(sample) > 0.0).unwrap();
    assert!(rate(&zeroed[first]) >= 0.75, "the first rate to be seen is {} degrees/s", rate(&zeroed[first]));
    let hidden = open[..first].iter().map(rate).fold(0.0, f64::max);
    assert!(hidden > 0.3 && hidden < 0.75, "the fastest hidden rate is {hidden} degrees/s");
    // On the first leg there is no standstill of 0.3 s: every sample is as it was measured, small ones too.
    assert!(zeroed[first..].iter().zip(&open[first..]).all(|(a, b)| a.gyro == b.gyro));
    assert!(zeroed[first..].iter().any(|sample| rate(sample) > 0.0 && rate(sample) < 0.75));
}

#[test]
fn the_noise_free_imu_integrates_from_the_standstill_to_the_truth_ten_seconds_later() {
    let mut rig = Rig::default();
    rig.imu_from_lidar.translation_m = [0.05, -0.02, 0.06];
    rig.imu_from_lidar.roll_pitch_yaw_deg = [0.5, -1.0, 1.5];
    let frames: Vec<Frame> = simulate(&ideal_imu(), &rig).unwrap().take(130).collect();
    let start = &frames[29].truth;
    let (mut p, mut v) = (Vector3::from(start.imu_position), Vector3::from(start.velocity));
    let mut q = map_from_imu(start).rotation;
    let gravity = Vector3::from(start.gravity);
    for frame in &frames[30..] {
        for pair in frame.imu.windows(2) {
            let h = (pair[1].stamp_ns - pair[0].stamp_ns) as f64 * 1e-9;
            let [w0, w1, a0, a1] =
                [pair[0].gyro, pair[1].gyro, pair[0].accel, pair[1].accel].map(Vector3::from);
            let turned = q * exp_so3(&((w0 + w1) * (h / 2.0)));
            let gain = (q * a0 + turned * a1) / 2.0 + gravity;
            p += v * h + gain * (h * h / 2.0);
            v += gain * h;
            q = turned;
        }
    }
    let end = &frames[129].truth;
    let off = (p - Vector3::from(end.imu_position)).norm();
    let turned = log_so3(&(q.inverse() * map_from_imu(end).rotation)).norm().to_degrees();
    // What is left is the 16-bit rounding: a random walk of 1.4 mm/s^2 per sample, twice integrated.
    assert!(off < 0.05, "position is off by {off} m");
    assert!(turned < 0.05, "rotation is off by {turned} degrees");
    assert!((v - Vector3::from(end.velocity)).norm() < 0.01);
}

#[test]
fn truth_starts_at_the_origin_of_a_level_map_and_keeps_the_rigs_extrinsic() {
    let mut rig = Rig::default();
    rig.imu_from_lidar.translation_m = [0.1, 0.05, -0.2];
    rig.imu_from_lidar.roll_pitch_yaw_deg = [2.0, -1.0, 30.0];
    let config = Config { mount_tilt_deg: [2.0, 3.0], seed: 8, ..Config::default() };
    let frames: Vec<Frame> = simulate(&config, &rig).unwrap().step_by(40).collect();
    let first = map_from_lidar(&frames[0].truth);
    assert!(first.translation.vector.norm() < 1e-12);
    let forward = first.rotation * Vector3::x();
    assert!(forward.y.abs() < 1e-12 && forward.x > 0.99, "{forward:?}");
    for frame in &frames {
        let difference =
            (map_from_imu(&frame.truth) * rig.imu_from_lidar()).inverse() * map_from_lidar(&frame.truth);
        assert!((difference.to_homogeneous() - Isometry3::identity().to_homogeneous()).norm() < 1e-9);
    }
    // At rest the accelerometer points against the map's gravity.
    let up = mean(&frames[0].imu, |sample| sample.accel) - Vector3::from(frames[0].truth.accel_bias);
    let up = map_from_imu(&frames[0].truth).rotation * up;
    assert!((up + Vector3::from(frames[0].truth.gravity)).norm() < 0.05, "{up:?}");
}

#[test]
fn walks_go_where_they_should() {
    let end = |world: WorldKind| {
        let frames = simulate(&Config { world, ..Config::default() }, &Rig::default()).unwrap();
        let walk = frames.walk();
        let steps =
            (0..=walk.frames()).map(|k| walk.map_from_lidar(k as i64 * 100_000_000).translation.vector);
        let places: Vec<Vector3<f64>> = steps.collect();
        let way: f64 = places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        (*places.last().unwrap(), way, walk.end_ns() as f64 * 1e-9)
    };
    let (place, way, seconds) = end(WorldKind::Corridor);
    assert!((place - Vector3::new(3.0, 0.0, 0.0)).norm() < 0.01, "{place:?}");
    assert!(way > 45.0 && way < 80.0 && seconds < 120.0, "{way} m in {seconds} s");
    let (place, way, _) = end(WorldKind::Hall);
    assert!((place - Vector3::new(4.0, 0.0, 0.0)).norm() < 0.3 && way > 60.0, "{place:?}, {way} m");
    let (place, way, _) = end(WorldKind::Stairwell);
    assert!((place.z - 3.4).abs() < 0.01 && way > 30.0, "{place:?}, {way} m");
}

#[test]
fn the_same_seed_gives_the_same_walk_and_another_seed_another() {
    let run = |seed| -> Vec<Frame> {
        let config = Config { seed, duration_s: Some(5.0), ..Config::default() };
        simulate(&config, &Rig::default()).unwrap().collect()
    };
    let (a, b, other) = (run(21), run(21), run(22));
    assert_eq!(a.len(), 50);
    for (a, b) in a.iter().zip(&b) {
        assert!(a.points == b.points && a.imu == b.imu && a.truth == b.truth && a.header == b.header);
    }
    assert!(a.iter().zip(&other).all(|(a, b)| a.points != b.points));
    assert!(a.iter().zip(&other).all(|(a, b)| a.imu != b.imu));
}

#[test]
fn an_imu_clock_that_is_ahead_stamps_the_same_motion_later() {
    let config = Config { gait: 0.0, ..ideal_imu() };
    let on_time = imu(&config, 12.0);
    let ahead = imu(&Config { imu_clock_offset_ms: 20.0, ..config }, 12.0);
    // 20 ms are four samples.
    for (sample, later) in on_time.iter().zip(&ahead[4..]) {
        assert_eq!(later.stamp_ns - sample.stamp_ns, 20_000_000);
        // One bit more or less where a value sits between two.
        assert!((Vector3::from(sample.accel) - Vector3::from(later.accel)).amax() < 0.006);
        assert!((Vector3::from(sample.gyro) - Vector3::from(later.gyro)).amax() < 0.0011);
    }
    assert!(on_time.iter().any(|sample| sample.accel[0].abs() > 0.5), "the walk has not begun");
}

#[test]
fn the_truth_knows_how_far_the_imu_clock_has_run_away() {
    let config = Config { imu_clock_offset_ms: 20.0, imu_clock_ppm: -500.0, seed: 4, ..Config::default() };
    let last = simulate(&config, &Rig::default()).unwrap().nth(99).unwrap().truth;
    // 20 ms ahead at the start and 5 ms lost in 10 s.
    assert_eq!((last.frame.end_ns, last.time_offset_ns), (10_000_000_000, -15_000_000));
    let frames = simulate(&Config { seed: 4, ..Config::default() }, &Rig::default()).unwrap();
    assert!(frames.take(3).all(|frame| frame.truth.time_offset_ns == 0));
}

#[test]
fn events_come_in_the_order_of_time_and_only_the_last_of_each_stream_ends_it() {
    let config = Config { duration_s: Some(2.0), seed: 3, ..Config::default() };
    let mut source = Simulator::new(config, &Rig::default()).unwrap();
    assert_eq!(source.total_scans(), Some(20));
    let (mut now, mut scans, mut samples, mut truths) = (0, Vec::new(), Vec::new(), Vec::new());
    while let Some(event) = source.next_event().unwrap() {
        let time = match event {
            SensorEvent::Imu(sample) => {
                samples.push(sample.flags);
                sample.stamp_ns
            }
            SensorEvent::Scan(header) => {
                let truth = source.truth().unwrap();
                assert_eq!(truth.frame.end_ns, header.frame.end_ns);
                truths.push(truth.frame.flags);
                scans.push(header.frame.flags);
                assert!(source.point(9_999).offset_ns() == 99_990_000);
                header.frame.end_ns
            }
        };
        assert!(time >= now, "{time} ns after {now} ns");
        now = time;
    }
    assert!(source.next_event().unwrap().is_none());
    assert_eq!((scans.len(), samples.len(), truths.len()), (20, 401, 20));
    for flags in [scans, samples, truths] {
        let (last, others) = flags.split_last().unwrap();
        assert_eq!(*last, frame_flags::END_OF_STREAM);
        assert!(others.iter().all(|flags| *flags == 0));
    }
}

#[test]
fn a_configuration_out_of_range_is_refused_before_anything_is_built() {
    let error = simulate(&Config { turn_rate_dps: 1e9, ..Config::default() }, &Rig::default()).unwrap_err();
    assert!(error.to_string().contains("turn_rate_dps"), "{error}");
}

#[test]
fn an_imu_at_half_the_rate_measures_the_same_motion_with_every_second_sample() {
    let config = ideal_imu();
    let (full, half) = (imu(&config, 8.0), imu(&Config { imu_rate_hz: 100, ..config.clone() }, 8.0));
    assert_eq!((full.len(), half.len()), (1601, 801));
    for (full, half) in full.iter().step_by(2).zip(&half) {
        assert_eq!((full.stamp_ns, full.gyro, full.accel), (half.stamp_ns, half.gyro, half.accel));
    }
}

#[test]
fn a_walk_that_starts_walking_is_the_same_walk_without_its_beginning() {
    let config = Config { start_walking: true, ..ideal_imu() };
    let walk = simulate(&config, &Rig::default()).unwrap().walk().clone();
    let whole = simulate(&ideal_imu(), &Rig::default()).unwrap().walk().clone();
    let skipped_ns = 4_500_000_000;
    assert_eq!(whole.end_ns() - walk.end_ns(), skipped_ns);
    let step = |walk: &evac_simulator::Walk, at: i64| {
        walk.map_from_lidar(at).inverse() * walk.map_from_lidar(at + 100_000_000)
    };
    // At full speed from the first frame on.
    assert!(step(&walk, 0).translation.vector.norm() > 0.1);
    for k in 0..50 {
        let at = k * 100_000_000;
        let difference = step(&walk, at).inverse() * step(&whole, at + skipped_ns);
        assert!((difference.to_homogeneous() - Isometry3::identity().to_homogeneous()).norm() < 1e-9);
    }
}
