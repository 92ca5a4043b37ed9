//! After warm-up the deskewer does not touch the heap.

mod synthetic;

use evac_deskewer::{Deskewer, DeskewerConfig};
use evac_stage::{Counters, ScanWithImu, Stage};
use evac_testkit::{CountingAllocator, count_allocations};
use synthetic::Motion;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn with_pose_without_and_without_imu_no_frame_allocates() {
    let motion = Motion::walking();
    let mut stage = Deskewer::new(DeskewerConfig::default(), &motion.rig).unwrap();
    let recordings: Vec<_> = (0..40).map(|seq| motion.scan(seq)).collect();
    let mut counters = Counters::default();
    let (mut kept, mut sum) = (0, 0.0);
    let allocations = count_allocations(|| {
        for (seq, recording) in recordings.iter().enumerate() {
            let input = match seq % 4 {
                0 => recording.input_without_prior(),
                1 if seq > 20 => ScanWithImu { imu: &[], imu_covers: false, ..recording.input() },
                _ => recording.input(),
            };
            let scan = stage.deskew(&input, &mut counters);
            kept += scan.len();
            sum += scan.points().map(|point| f64::from(point.x)).sum::<f64>();
        }
    });
    assert_eq!(allocations, 0);
    assert!(kept == 400_000 && sum.is_finite() && counters.degraded == 5, "{kept} {sum} {counters:?}");
}
