//! When plans are published and saved, and what bad messages do.

use super::*;

#[test]
fn a_lost_pose_walks_nowhere() {
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    let before = bench.plan();
    bench.state = TrackingState::Lost;
    bench.walk([4.0, 0.0, 0.0], [4.0, 9.0, 0.0], &[]);
    assert_eq!(bench.plan().0, before.0);
    assert_eq!(bench.counters, Counters { degraded: 51, ..Counters::default() });
}

#[test]
fn a_snapshot_replaces_the_map() {
    let mut bench = Bench::new();
    bench.walk(
        [0.0; 3],
        [4.0, 0.0, 0.0],
        &[voxel(20.0, 0.0, 0.0, OCCUPIED_VALUE, 2), voxel(20.0, 0.0, 0.1, 2.0, 2)],
    );
    bench.send([4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT), map_flags::SNAPSHOT);
    let mut other = Bench::new();
    other.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    assert_eq!(bench.plan().0, other.plan().0);
}

#[test]
fn a_plan_is_published_with_the_frame_that_changes_it_not_again_without_a_change_and_at_the_end() {
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    let times = |bench: &Bench| -> Vec<i64> {
        bench.output.memory.iter().map(|(header, _)| header.frame.end_ns / 100_000_000).collect()
    };
    let (first, before) = (times(&bench)[0], times(&bench).len());
    assert!(first == 1 && before < 51, "frame {first}, {before} plans for 51 frames");
    let mut box_ = Vec::new();
    column(&mut box_, 2.05, 1.05, -SENSOR_HEIGHT, |above| above < 1.0);
    bench.send([4.0, 0.0, 0.0], &box_, 0);
    bench.send([4.0, 0.0, 0.0], &[], 0);
    assert_eq!(times(&bench)[before..], [52], "the plan of frame 52 shows what came with it");

    let mut seldom = Bench::with(|config| config.publish_interval_s = 2.0);
    seldom.walk([0.0; 3], [10.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    assert_eq!(times(&seldom), [21, 41]);

    let frame =
        FrameHeader { end_ns: 5_300_000_000, flags: frame_flags::END_OF_STREAM, ..FrameHeader::default() };
    let header = MapHeader { frame, resolution: RESOLUTION, ..MapHeader::default() };
    let pose = PoseFrame { frame, ..PoseFrame::default() };
    let input = PlanInput { map: MapMessage { header: &header, voxels: &[] }, pose: &pose };
    bench.stage.process(input, &mut bench.output, &mut bench.counters).unwrap();
    let (last, cells) = bench.output.memory.last().unwrap();
    assert_eq!(last.frame, frame);
    let grid = &bench.stage.grid;
    assert_eq!(
        (last.width, last.height, last.origin),
        (grid.width, grid.height, [grid.origin[0], grid.origin[1]])
    );
    assert_eq!(cells, &grid.cells);
    // The end has saved the files already.
    fs::remove_file(bench.folder.path().join("out/plan.png")).unwrap();
    bench.stage.finish().unwrap();
    assert!(!bench.folder.path().join("out/plan.png").exists());
}

#[test]
fn two_runs_write_the_same_bytes() {
    let files = || {
        let mut bench = Bench::new();
        bench.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
        bench.stage.finish().unwrap();
        ["plan.pgm", "plan.yaml", "plan.png"]
            .map(|name| fs::read(bench.folder.path().join("out").join(name)).unwrap())
    };
    assert!(files() == files());
}

#[test]
fn nothing_seen_gives_no_files_and_bad_data_are_counted() {
    let mut bench = Bench::new();
    bench.stage.finish().unwrap();
    bench.send([f64::NAN, 0.0, 0.0], &room(0.0), 0);
    assert_eq!(bench.counters, Counters { degraded: 2, ..Counters::default() });
    bench.send([0.0; 3], &[], 0);
    bench.stage.finish().unwrap();
    assert_eq!(fs::read_dir(bench.folder.path().join("out")).unwrap().count(), 0);
    bench.send([0.0; 3], &[voxel(1000.0, 0.0, 0.0, 1.0, 2), voxel(0.0, 0.0, 0.0, f32::NAN, 2)], 0);
    assert_eq!(bench.counters.rejected, 2);
}
