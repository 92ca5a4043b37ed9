//! Every fault does what its name says, and nothing else.
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic as the test may")]

mod common;

use common::{REST_S, SECONDS, walk};
use evac_experiments::{Fault, Walk};
use evac_frames::{ImuSample, frame_flags};
use evac_geometry::STANDARD_GRAVITY;
use evac_geometry::nalgebra::Vector3;

/// Every frame has the samples that the run loop would give it: cover on both sides, except where the stream ends.
fn assert_covered(walk: &Walk) {
    let mut previous_end_ns = None;
    let all = walk.imu();
    let (first, last) = (all.first().unwrap().stamp_ns, all.last().unwrap().stamp_ns);
    for frame in &walk.frames {
        let header = &frame.header.frame;
        let from = previous_end_ns.unwrap_or(i64::MIN).min(header.start_ns).max(first);
        let to = header.end_ns.min(last);
        assert!(
            frame.imu.first().unwrap().stamp_ns <= from,
            "frame {} has no sample at its start",
            header.seq
        );
        assert!(frame.imu.last().unwrap().stamp_ns >= to, "frame {} has no sample at its end", header.seq);
        let inner = &frame.imu[1..frame.imu.len() - 1];
        assert!(inner.iter().all(|sample| sample.stamp_ns > from && sample.stamp_ns < to));
        assert!(frame.imu.is_sorted_by(|a, b| a.stamp_ns < b.stamp_ns));
        previous_end_ns = Some(header.end_ns);
    }
    assert!(walk.frames.last().unwrap().header.frame.flags & frame_flags::END_OF_STREAM != 0);
    assert_eq!(
        walk.frames.iter().filter(|f| f.header.frame.flags & frame_flags::END_OF_STREAM != 0).count(),
        1
    );
}

fn shifts(before: &[ImuSample], after: &[ImuSample]) -> Vec<i64> {
    before.iter().zip(after).map(|(before, after)| after.stamp_ns - before.stamp_ns).collect()
}

#[test]
fn every_fault_leaves_every_scan_covered_and_the_same_seed_gives_the_same_walk() {
    let walk = walk(7);
    for fault in Fault::ALL {
        let faulty = fault.applied(&walk, 3);
        assert_covered(&faulty);
        let again = fault.applied(&walk, 3);
        assert_eq!(faulty.rig, again.rig, "{}", fault.name());
        for (a, b) in faulty.frames.iter().zip(&again.frames) {
            assert_eq!((a.header, &a.imu), (b.header, &b.imu), "{}", fault.name());
            let bits = |p: &evac_frames::Point| [p.x.to_bits(), p.y.to_bits(), p.z.to_bits(), p.packed];
            assert!(a.points.iter().map(bits).eq(b.points.iter().map(bits)), "{}", fault.name());
        }
    }
}

#[test]
fn names_of_faults_differ() {
    let mut names: Vec<_> = Fault::ALL.iter().map(|fault| fault.name()).collect();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), Fault::ALL.len());
}

#[test]
fn a_clock_offset_moves_the_imus_stamps_and_nothing_else() {
    let walk = walk(1);
    for ms in [-80, 20] {
        let late = Fault::ClockOffsetMs(ms).applied(&walk, 1);
        let (before, after) = (walk.imu(), late.imu());
        assert!(shifts(&before, &after).iter().all(|shift| *shift == i64::from(ms) * 1_000_000));
        assert!(before.iter().zip(&after).all(|(a, b)| (a.gyro, a.accel) == (b.gyro, b.accel)));
        let headers = |walk: &Walk| walk.frames.iter().map(|frame| frame.header).collect::<Vec<_>>();
        assert_eq!(headers(&walk), headers(&late));
    }
}

#[test]
fn auto_zero_reads_exact_zeros_at_rest_and_hides_the_slow_start_of_a_turn_only() {
    let walk = walk(2);
    let zeroed = Fault::AutoZero.applied(&walk, 1);
    let hidden_s = 0.2;
    for (before, after) in walk.imu().iter().zip(zeroed.imu()) {
        let t = before.stamp_ns as f64 * 1e-9;
        if t < REST_S - 0.01 {
            assert_eq!(after.gyro, [0.0; 3], "at {t}");
        } else if t > REST_S + hidden_s + 0.3 {
            assert_eq!(after.gyro, before.gyro, "at {t}");
        }
        assert_eq!(after.accel, before.accel);
    }
    let at = |walk: &Walk, t: f64| {
        walk.imu().into_iter().find(|sample| sample.stamp_ns as f64 * 1e-9 >= t).unwrap().gyro[2]
    };
    // Just after the rest a rate of 0.5 deg/s is there, and is hidden.
    assert!(at(&walk, REST_S + 0.05).abs() > 0.3_f64.to_radians());
    assert_eq!(at(&zeroed, REST_S + 0.05), 0.0);
}

#[test]
fn a_walk_whose_gyroscope_zeroes_itself_stays_as_it_is() {
    let zeroed = Fault::AutoZero.applied(&walk(2), 1);
    assert_eq!(Fault::AutoZero.applied(&zeroed, 1).imu(), zeroed.imu());
}

#[test]
fn a_wrong_rig_is_off_by_just_so_much_and_the_data_stay() {
    let walk = walk(3);
    let angle = |faulty: &Walk| {
        (walk.rig.imu_from_lidar().rotation.inverse() * faulty.rig.imu_from_lidar().rotation)
            .angle()
            .to_degrees()
    };
    for (tenths, seed) in [(5, 1), (10, 2)] {
        let faulty = Fault::Rotation(tenths).applied(&walk, seed);
        assert!((angle(&faulty) - 0.1 * f64::from(tenths)).abs() < 1e-9, "{}", angle(&faulty));
        assert_eq!(faulty.rig.imu_from_lidar.translation_m, walk.rig.imu_from_lidar.translation_m);
        assert_eq!(faulty.imu(), walk.imu());
    }
    let moved = Fault::Translation.applied(&walk, 1);
    let by = Vector3::from(moved.rig.imu_from_lidar.translation_m)
        - Vector3::from(walk.rig.imu_from_lidar.translation_m);
    assert!((by.norm() - 0.02).abs() < 1e-12);
    assert!(angle(&moved) < 1e-9);
}

#[test]
fn the_accelerometers_noise_becomes_three_times_as_large() {
    let walk = walk(4);
    let noisy = Fault::AccelNoise.applied(&walk, 5);
    let added: Vec<f64> = (walk.imu().iter().zip(noisy.imu()))
        .flat_map(|(a, b)| (0..3).map(move |axis| b.accel[axis] - a.accel[axis]))
        .collect();
    let variance = added.iter().map(|noise| noise * noise).sum::<f64>() / added.len() as f64;
    let total = (variance + 0.03_f64.powi(2)).sqrt();
    assert!((total - 0.09).abs() < 0.002, "{total}");
}

#[test]
fn scale_range_and_unit_are_off_by_their_factor() {
    let walk = walk(5);
    let (scaled, in_g) = (Fault::GyroScale.applied(&walk, 1), Fault::ImuInG.applied(&walk, 1));
    for ((before, scaled), in_g) in walk.imu().iter().zip(scaled.imu()).zip(in_g.imu()) {
        for axis in 0..3 {
            assert!((scaled.gyro[axis] - 1.005 * before.gyro[axis]).abs() < 1e-15);
            assert!((in_g.accel[axis] * STANDARD_GRAVITY - before.accel[axis]).abs() < 1e-12);
        }
    }
    let longer = Fault::RangeBias.applied(&walk, 1);
    for (before, after) in walk.frames.iter().zip(&longer.frames) {
        for (before, after) in before.points.iter().zip(after.points.iter()) {
            let range = |p: &evac_frames::Point| f64::from(p.x * p.x + p.y * p.y + p.z * p.z).sqrt();
            let longer = if before.is_return() { 0.02 } else { 0.0 };
            assert!((range(after) - range(before) - longer).abs() < 1e-5);
        }
    }
}

#[test]
fn gaps_of_the_imu_have_their_length_and_their_period() {
    let walk = walk(6);
    let gaps = |fault: Fault| -> Vec<f64> {
        let imu = fault.applied(&walk, 1).imu();
        let apart = imu.windows(2).map(|pair| (pair[1].stamp_ns - pair[0].stamp_ns) as f64 * 1e-9);
        apart.filter(|apart| *apart > 0.006).collect()
    };
    assert_eq!(gaps(Fault::None), Vec::<f64>::new());
    let short = gaps(Fault::ImuGaps);
    assert_eq!(short.len(), (SECONDS / 7.0) as usize);
    assert!(short.iter().all(|gap| (0.045..=0.06).contains(gap)), "{short:?}");
    let long = gaps(Fault::ImuGap);
    assert!(long.len() == 1 && (0.49..=0.51).contains(&long[0]), "{long:?}");
    let half = Fault::Imu100Hz.applied(&walk, 1).imu();
    assert!(half.windows(2).all(|pair| pair[1].stamp_ns - pair[0].stamp_ns == 10_000_000));
    assert!(half.iter().zip(0..).all(|(sample, seq)| sample.seq == seq));
}

#[test]
fn scans_of_a_lidar_gap_are_missing_by_their_numbers_and_their_imu_goes_to_the_next_scan() {
    let walk = walk(6);
    let heard = Fault::LidarGaps.applied(&walk, 1);
    assert_eq!(heard.frames.len(), walk.frames.len() - 10 * (SECONDS / 10.0) as usize);
    let after_gap = heard.frames.iter().find(|frame| frame.header.frame.seq == 100).unwrap();
    assert!(heard.frames.iter().all(|frame| frame.header.frame.seq % 100 < 90));
    assert!(after_gap.imu.len() > 200, "{}", after_gap.imu.len());
    assert_eq!(heard.imu().len(), walk.imu().iter().filter(|s| s.stamp_ns <= heard_until(&heard)).count());
}

fn heard_until(walk: &Walk) -> i64 {
    walk.frames.last().unwrap().header.frame.end_ns
}

#[test]
fn one_point_in_twenty_is_corrupt_and_the_others_stay() {
    let walk = walk(8);
    let corrupt = Fault::CorruptPoints.applied(&walk, 4);
    let (mut changed, mut all, mut not_a_number, mut origin) = (0, 0, 0, 0);
    for (before, after) in walk.frames.iter().zip(&corrupt.frames) {
        for (before, after) in before.points.iter().zip(after.points.iter()) {
            all += 1;
            changed += usize::from(before != after);
            not_a_number += usize::from(!after.is_finite());
            origin += usize::from(before.is_return() && !after.is_return());
            assert_eq!(before.packed, after.packed);
        }
    }
    let share = |count: usize| count as f64 / all as f64;
    assert!((share(changed) - 0.05).abs() < 0.005, "{}", share(changed));
    assert!((share(not_a_number) - 0.05 / 3.0).abs() < 0.003 && (share(origin) - 0.05 / 3.0).abs() < 0.003);
}

#[test]
fn one_sample_of_the_gyroscope_spikes_in_motion() {
    let walk = walk(9);
    let spiked = Fault::GyroSpike.applied(&walk, 6).imu();
    let different: Vec<_> = walk.imu().into_iter().zip(spiked).filter(|(a, b)| a != b).collect();
    assert_eq!(different.len(), 1);
    let (before, after) = different[0];
    let spikes: Vec<_> = (0..3).filter(|axis| before.gyro[*axis] != after.gyro[*axis]).collect();
    assert_eq!(spikes.len(), 1);
    assert!((after.gyro[spikes[0]].to_degrees() - 1600.0).abs() < 1e-9);
    assert!(after.stamp_ns as f64 * 1e-9 > REST_S);
}

#[test]
fn stamps_from_the_epoch_move_scans_and_samples_together() {
    let walk = walk(10);
    for (fault, low, high) in
        [(Fault::EpochStamps, 1_700_000_000_000_000_000, i64::MAX), (Fault::BootStamps, 1, 1_000_000_000_000)]
    {
        let moved = fault.applied(&walk, 1);
        let by = moved.frames[0].header.frame.start_ns - walk.frames[0].header.frame.start_ns;
        assert!((low..=high).contains(&moved.frames[0].header.frame.start_ns));
        assert!(shifts(&walk.imu(), &moved.imu()).iter().all(|shift| *shift == by));
        let frames = walk.frames.iter().zip(&moved.frames);
        assert!(frames.clone().all(|(a, b)| b.header.frame.end_ns - a.header.frame.end_ns == by));
        assert!(frames.clone().all(|(a, b)| a.truth == b.truth));
    }
}

#[test]
fn a_person_half_a_metre_ahead_hides_most_of_the_view_for_three_seconds() {
    let walk = walk(11);
    let hidden = Fault::Person.applied(&walk, 1);
    let mut frames_hidden = 0;
    for (before, after) in walk.frames.iter().zip(&hidden.frames) {
        let near = after.points.iter().filter(|p| p.is_return() && p.x < 1.0).count();
        let returns = before.points.iter().filter(|p| p.is_return()).count();
        let share = near as f64 / returns as f64;
        assert!(share == 0.0 || share > 0.5, "{share}");
        frames_hidden += usize::from(share > 0.0);
        let nearest =
            after.points.iter().filter(|p| p.is_return()).map(|p| p.x).fold(f32::INFINITY, f32::min);
        assert!(share == 0.0 || (nearest - 0.5).abs() < 0.1, "{nearest}");
    }
    assert_eq!(frames_hidden, 30);
}

#[test]
fn a_start_while_walking_begins_in_full_stride_with_its_truth_at_the_new_start() {
    let walk = walk(12);
    let cut = Fault::StartWalking.applied(&walk, 1);
    assert!(cut.frames.len() < walk.frames.len());
    let first = &cut.frames[0];
    assert_eq!(first.header.frame.seq, 0);
    assert!(first.truth.translation.vector.norm() < 1e-12);
    assert!(cut.speed(1) > 0.7, "{}", cut.speed(1));
    assert!(first.imu[0].stamp_ns >= first.header.frame.start_ns);
    let way = |walk: &Walk, from: usize| {
        let (a, b) = (&walk.frames[from], walk.frames.last().unwrap());
        (a.truth.inverse() * b.truth).translation.vector
    };
    let from = walk.frames.len() - cut.frames.len();
    assert!((way(&walk, from) - way(&cut, 0)).norm() < 1e-9);
}
