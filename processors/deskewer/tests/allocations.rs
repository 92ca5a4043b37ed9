//! After warm-up the deskewer does not touch the heap.

mod synthetic;

use evac_deskewer::{Deskewer, DeskewerConfig};
use evac_stage::{Counters, ScanOutput, ScanWithImu, Stage};
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
    let mut output = ScanOutput::newest_only();
    // The output's own buffer is made here.
    stage.process(recordings[0].input(), &mut output, &mut counters).unwrap();
    let allocations = count_allocations(|| {
        for (seq, recording) in recordings.iter().enumerate().skip(1) {
            let input = match seq % 4 {
                0 => recording.input_without_prior(),
                1 if seq > 20 => ScanWithImu { imu: &[], imu_covers: false, ..recording.input() },
                _ => recording.input(),
            };
            stage.process(input, &mut output, &mut counters).unwrap();
        }
    });
    assert_eq!(allocations, 0);
    assert_eq!((output.memory.len(), output.memory[0].1.len(), counters.degraded), (1, 10_000, 5));
}
