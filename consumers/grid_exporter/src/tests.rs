//! Physics of the plan on synthetic buildings at 0.1 m: the LiDAR starts at the map's origin, 1.2 m above the ground.

use std::fs;

use evac_formats::occupancy_grid::{FREE, OCCUPIED, OccupancyGrid, UNKNOWN};
use evac_frames::{PoseFrame, Voxel, voxel_flags};
use evac_stage::MapMessage;

use super::*;

const RESOLUTION: f64 = 0.1;
const SENSOR_HEIGHT: f64 = 1.2;
const OCCUPIED_VALUE: f32 = 2.0;
const FREE_VALUE: f32 = -1.0;

struct Bench {
    stage: GridExporter,
    output: GridOutput,
    counters: Counters,
    folder: tempfile::TempDir,
    time_ns: i64,
    state: TrackingState,
}

impl Bench {
    fn new() -> Self {
        Self::with(|_| {})
    }

    fn with(change: impl FnOnce(&mut GridExporterConfig)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut config =
            GridExporterConfig { output_dir: folder.path().join("out"), ..GridExporterConfig::default() };
        change(&mut config);
        Self {
            stage: GridExporter::new(config, &Rig::default()).unwrap(),
            output: GridOutput::default(),
            counters: Counters::default(),
            folder,
            time_ns: 0,
            state: TrackingState::Tracking,
        }
    }

    fn send(&mut self, position: [f64; 3], voxels: &[Voxel], flags: u32) {
        self.time_ns += 100_000_000;
        let frame = FrameHeader { end_ns: self.time_ns, ..FrameHeader::default() };
        let header =
            MapHeader { frame, resolution: RESOLUTION, position, map_flags: flags, ..MapHeader::default() };
        let pose = PoseFrame { frame, position, state: self.state as u32, ..PoseFrame::default() };
        let input = PlanInput { map: MapMessage { header: &header, voxels }, pose: &pose };
        self.stage.process(input, &mut self.output, &mut self.counters).unwrap();
    }

    fn walk(&mut self, from: [f64; 3], to: [f64; 3], voxels: &[Voxel]) {
        self.send(from, voxels, 0);
        for i in 1..=50 {
            let share = f64::from(i) / 50.0;
            let position = [0, 1, 2].map(|axis: usize| from[axis] + (to[axis] - from[axis]) * share);
            self.send(position, &[], 0);
        }
    }

    fn plan(&mut self) -> Plan {
        self.stage.finish().unwrap();
        let read = evac_formats::occupancy_grid::read(&self.folder.path().join("out/plan.yaml"));
        Plan(read.unwrap())
    }
}

struct Plan(OccupancyGrid);

impl Plan {
    /// The cell at a place, metres.
    fn at(&self, x: f64, y: f64) -> i8 {
        let [cx, cy] = [(x, self.0.origin[0]), (y, self.0.origin[1])]
            .map(|(value, origin)| ((value - origin) / self.0.resolution).floor() as i64);
        let inside =
            (0..i64::from(self.0.width)).contains(&cx) && (0..i64::from(self.0.height)).contains(&cy);
        if inside { self.0.cells[cy as usize * self.0.width as usize + cx as usize] } else { UNKNOWN }
    }

    fn count(&self, state: i8) -> usize {
        self.0.cells.iter().filter(|cell| **cell == state).count()
    }
}

fn voxel(x: f64, y: f64, z: f64, log_odds: f32, flags: u16) -> Voxel {
    let key = [x, y, z].map(|axis| ((axis / RESOLUTION).floor() as i32 + 32_768) as u16);
    Voxel { key, flags, log_odds }
}

/// Centres of the voxels from `low` to `high`.
fn steps(low: f64, high: f64) -> impl Iterator<Item = f64> + Clone {
    let count = ((high - low) / RESOLUTION).round() as i32;
    (0..count).map(move |i| low + (f64::from(i) + 0.5) * RESOLUTION)
}

/// A column: ground at `ground`, then free, or occupied where `solid` says so by the height above ground.
fn column(voxels: &mut Vec<Voxel>, x: f64, y: f64, ground: f64, solid: impl Fn(f64) -> bool) {
    voxels.push(voxel(x, y, ground, FREE_VALUE, voxel_flags::KNOWN | voxel_flags::GROUND));
    for above in steps(0.1, 2.6) {
        let value = if solid(above) { OCCUPIED_VALUE } else { FREE_VALUE };
        voxels.push(voxel(x, y, ground + above, value, voxel_flags::KNOWN));
    }
}

/// A wall over one cell: seen from the side, so without ground below it.
fn wall(voxels: &mut Vec<Voxel>, x: f64, y: f64, ground: f64) {
    for above in steps(0.0, 2.6) {
        voxels.push(voxel(x, y, ground + above, OCCUPIED_VALUE, voxel_flags::KNOWN));
    }
}

/// Walls around x from -1 to 5 m, y from -2 to 2 m, a door in the wall at x = 5 from y = -0.5 to 0.5 m, a ceiling.
fn room(ground: f64) -> Vec<Voxel> {
    let mut voxels = Vec::new();
    for (x, y) in steps(-1.0, 5.0).flat_map(|x| steps(-2.0, 2.0).map(move |y| (x, y))) {
        if x < -0.9 || y.abs() > 1.9 || (x > 4.9 && y.abs() > 0.5) {
            wall(&mut voxels, x, y, ground);
        } else {
            column(&mut voxels, x, y, ground, |above| above > 2.4);
        }
    }
    voxels
}

#[test]
fn a_room_is_an_occupied_ring_with_a_free_door_and_free_inside_and_unknown_outside() {
    // The configured sensor height is wrong on purpose: it is measured from the ground under the path.
    let mut bench = Bench::with(|config| config.sensor_height_m = 2.5);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    let plan = bench.plan();
    for (x, y) in steps(-1.0, 5.0).flat_map(|x| steps(-2.0, 2.0).map(move |y| (x, y))) {
        let ring = x < -0.9 || y.abs() > 1.9 || (x > 4.9 && y.abs() > 0.5);
        assert_eq!(plan.at(x, y), if ring { OCCUPIED } else { FREE }, "{x} {y}");
    }
    assert_eq!(plan.at(4.95, 0.0), FREE);
    assert_eq!(plan.count(FREE) + plan.count(OCCUPIED), 60 * 40);
    // Half a metre of margin on every side.
    assert_eq!((plan.0.width, plan.0.height), (70, 50));
    assert!((plan.0.origin[0] + 1.5).abs() < 1e-9 && (plan.0.origin[1] + 2.5).abs() < 1e-9);
}

#[test]
fn what_hangs_above_the_band_does_not_block_and_what_stands_in_it_does() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (y, solid) in [(-1.05, 1.95..2.2), (0.05, 0.25..0.4), (1.05, 0.0..0.15)] {
        for x in steps(2.0, 3.0) {
            column(&mut voxels, x, y, -SENSOR_HEIGHT, |above| solid.contains(&above));
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(2.55, -1.05), FREE, "a lamp 2 m above the ground");
    assert_eq!(plan.at(2.55, 0.05), OCCUPIED, "a low box");
    assert_eq!(plan.at(2.55, 1.05), FREE, "a threshold");
}

#[test]
fn a_column_of_ceiling_only_is_neither_occupied_nor_free() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(6.0, 7.0).flat_map(|x| steps(-0.5, 0.5).map(move |y| (x, y))) {
        voxels.push(voxel(x, y, -SENSOR_HEIGHT + 2.45, OCCUPIED_VALUE, voxel_flags::KNOWN));
        voxels.push(voxel(x, y, -SENSOR_HEIGHT + 2.05, FREE_VALUE, voxel_flags::KNOWN));
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(6.55, 0.05), UNKNOWN);
}

#[test]
fn a_single_voxel_is_no_obstacle_and_not_free_and_a_post_is_an_obstacle() {
    let mut voxels = room(-SENSOR_HEIGHT);
    column(&mut voxels, 2.05, 1.05, -SENSOR_HEIGHT, |above| (above - 0.95).abs() < 0.01);
    column(&mut voxels, 3.05, 1.05, -SENSOR_HEIGHT, |above| above < 1.0);
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(2.05, 1.05), UNKNOWN);
    assert_eq!(plan.at(3.05, 1.05), OCCUPIED);
}

#[test]
fn space_seen_only_over_a_table_is_not_free_and_space_seen_down_to_near_the_floor_is() {
    let mut voxels = room(-SENSOR_HEIGHT);
    let air = |y: f64, heights: &[f64]| -> Vec<Voxel> {
        let each = heights.iter();
        each.map(|z| voxel(6.05, y, z - SENSOR_HEIGHT, FREE_VALUE, voxel_flags::KNOWN)).collect()
    };
    let over_a_table: Vec<f64> = steps(0.8, 1.8).collect();
    voxels.extend(air(0.05, &over_a_table));
    voxels.extend(air(0.25, &[0.05, 0.15, 0.35, 1.5]));
    voxels.extend(air(0.45, &[0.35, 0.45]));
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(6.05, 0.05), UNKNOWN, "over a table");
    assert_eq!(plan.at(6.05, 0.25), UNKNOWN, "a single ray");
    assert_eq!(plan.at(6.05, 0.45), FREE);
}

#[test]
fn a_stair_that_leads_down_and_a_hole_are_not_free() {
    // Behind the door a flight of steps leads down, its treads seen as obstacles from above; at y > 0.2 there is a hole
    // without anything seen below.
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(5.0, 7.0).flat_map(|x| steps(-0.5, 0.5).map(move |y| (x, y))) {
        let tread = if y > 0.2 { -3.0 } else { -0.17 * ((x - 5.0) / 0.28).floor() };
        if y < 0.2 {
            voxels.push(voxel(x, y, tread - SENSOR_HEIGHT - 0.01, OCCUPIED_VALUE, voxel_flags::KNOWN));
        }
        for z in steps(tread + 0.1, 1.8) {
            voxels.push(voxel(x, y, z - SENSOR_HEIGHT, FREE_VALUE, voxel_flags::KNOWN));
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    for x in steps(5.0, 7.0) {
        assert_eq!(plan.at(x, 0.35), UNKNOWN, "the hole at {x}");
    }
    // From the third step on, 0.5 m below the floor.
    for (x, y) in steps(5.9, 7.0).flat_map(|x| steps(-0.5, 0.1).map(move |y| (x, y))) {
        assert_eq!(plan.at(x, y), UNKNOWN, "the stair at {x} {y}");
    }
}

#[test]
fn an_even_top_too_high_to_step_on_is_an_obstacle_although_the_mapper_took_it_for_ground() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(2.0, 3.0).flat_map(|x| steps(0.5, 1.5).map(move |y| (x, y))) {
        voxels.retain(|other| other.key[..2] != voxel(x, y, 0.0, 0.0, 0).key[..2]);
        column(&mut voxels, x, y, 0.85 - SENSOR_HEIGHT, |_| false);
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    for (x, y) in steps(2.0, 3.0).flat_map(|x| steps(0.5, 1.5).map(move |y| (x, y))) {
        assert_eq!(plan.at(x, y), OCCUPIED, "{x} {y}");
    }
}

#[test]
fn gaps_too_narrow_for_anyone_are_closed_and_a_passage_is_not() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for x in [2.05, 2.35, 3.05, 3.45] {
        column(&mut voxels, x, 1.05, -SENSOR_HEIGHT, |above| above < 1.0);
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!([2.15, 2.25].map(|x| plan.at(x, 1.05)), [OCCUPIED; 2], "0.2 m");
    assert_eq!([3.15, 3.25, 3.35].map(|x| plan.at(x, 1.05)), [FREE; 3], "0.3 m");
}

#[test]
fn where_somebody_walked_is_free_although_the_floor_was_not_seen_unless_something_stands_there() {
    let mut voxels = room(-SENSOR_HEIGHT);
    wall(&mut voxels, 8.05, 0.05, -SENSOR_HEIGHT);
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [10.0, 0.0, 0.0], &voxels);
    let walked = bench.plan();
    for x in steps(5.0, 8.7) {
        let expected = if (x - 8.05).abs() < 0.01 { OCCUPIED } else { FREE };
        assert_eq!(walked.at(x, 0.05), expected, "{x}");
        assert_eq!(walked.at(x, 0.55), UNKNOWN, "beside the path at {x}");
    }
}

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
fn a_person_who_walked_away_leaves_no_trace() {
    let mut bench = Bench::new();
    let mut voxels = room(-SENSOR_HEIGHT);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let before = bench.plan();
    let mut person = Vec::new();
    for (x, y) in steps(2.0, 2.4).flat_map(|x| steps(1.0, 1.4).map(move |y| (x, y))) {
        column(&mut person, x, y, -SENSOR_HEIGHT, |above| above < 1.7);
    }
    bench.send([4.0, 0.0, 0.0], &person, 0);
    assert_eq!(bench.plan().at(2.25, 1.25), OCCUPIED);
    voxels.retain(|voxel| person.iter().any(|other| other.key == voxel.key));
    bench.send([4.0, 0.0, 0.0], &voxels, 0);
    assert_eq!(bench.plan().0, before.0);
}

#[test]
fn along_a_ramp_the_band_follows_the_ground() {
    // 10 % over 20 m: at its end the ground is 2 m higher, above the whole band of its beginning.
    let rise = |x: f64| -SENSOR_HEIGHT + 0.1 * x;
    let mut voxels = Vec::new();
    for x in steps(0.0, 20.0) {
        for y in steps(-1.0, 1.0) {
            if y.abs() > 0.9 {
                wall(&mut voxels, x, y, rise(x));
            } else {
                // A ceiling 2.2 m above the ramp, and a box of 0.5 m at two places.
                let boxed = y > 0.5 && (x - 1.0).abs().min((x - 19.0).abs()) < 0.3;
                column(&mut voxels, x, y, rise(x), |above| above > 2.2 || boxed && above < 0.5);
            }
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.5, 0.0, 0.05], [19.5, 0.0, 1.95], &voxels);
    let plan = bench.plan();
    for x in steps(0.0, 20.0) {
        assert_eq!(plan.at(x, 0.05), FREE, "{x}");
        assert_eq!([plan.at(x, 0.95), plan.at(x, -0.95)], [OCCUPIED; 2], "{x}");
    }
    assert_eq!([plan.at(1.05, 0.75), plan.at(19.05, 0.75)], [OCCUPIED; 2]);
    assert_eq!(plan.at(10.05, 0.75), FREE);
}

#[test]
fn a_storey_seen_later_changes_nothing_where_the_first_one_is() {
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &room(-SENSOR_HEIGHT));
    let before = bench.plan();
    // Up a flight of stairs over the room, then about on a storey 3 m higher with a wall across it.
    let mut upper = Vec::new();
    for (x, y) in steps(-0.9, 4.9).flat_map(|x| steps(-1.9, 1.9).map(move |y| (x, y))) {
        if (x - 2.05).abs() < 0.1 {
            wall(&mut upper, x, y, 3.0 - SENSOR_HEIGHT);
        } else {
            column(&mut upper, x, y, 3.0 - SENSOR_HEIGHT, |above| above > 2.4);
        }
    }
    bench.walk([4.0, 0.0, 0.0], [0.0, 0.0, 3.0], &upper);
    bench.walk([0.0, 0.0, 3.0], [4.0, 0.0, 3.0], &[]);
    assert_eq!(bench.plan().0, before.0);
}

#[test]
fn a_stair_that_was_climbed_is_free_and_the_floor_beside_it_stays_on_the_plan() {
    // A corridor from x = -1 to 10; from 4 to 7.4 m, at y < 0, a flight of ten steps to a landing from 7.4 m on.
    let tread = |x: f64| if x < 4.0 { 0.0 } else { (((x - 4.0) / 0.34).floor() + 1.0).min(10.0) * 0.17 };
    let mut voxels = Vec::new();
    for (x, y) in steps(-1.0, 10.0).flat_map(|x| steps(-1.5, 1.5).map(move |y| (x, y))) {
        if y.abs() > 1.4 {
            wall(&mut voxels, x, y, -SENSOR_HEIGHT);
        } else if y < 0.0 && tread(x) > 0.0 {
            // A stair is no ground to the mapper: its treads are occupied voxels.
            voxels.push(voxel(x, y, tread(x) - SENSOR_HEIGHT - 0.01, OCCUPIED_VALUE, voxel_flags::KNOWN));
            let above = steps(0.1, 2.6).map(|above| tread(x) - SENSOR_HEIGHT - 0.01 + above);
            voxels.extend(above.map(|z| voxel(x, y, z, FREE_VALUE, voxel_flags::KNOWN)));
        } else {
            column(&mut voxels, x, y, -SENSOR_HEIGHT, |_| false);
        }
    }
    let mut bench = Bench::new();
    bench.walk([0.0, -0.7, 0.0], [3.9, -0.7, 0.0], &voxels);
    bench.walk([3.9, -0.7, 0.0], [7.3, -0.7, 1.7], &[]);
    bench.walk([7.3, -0.7, 1.7], [9.0, -0.7, 1.7], &[]);
    let plan = bench.plan();
    for x in steps(0.0, 10.0) {
        assert_eq!(plan.at(x, -0.75), FREE, "on the way at {x}");
        assert_eq!([plan.at(x, -1.45), plan.at(x, 1.45)], [OCCUPIED; 2], "{x}");
    }
    // Seen from below the flight would be a wall; beside it the floor goes on.
    assert!(steps(0.0, 10.0).all(|x| plan.at(x, 0.75) == FREE));
}

#[test]
fn the_void_of_a_gallery_is_not_free() {
    let mut voxels = room(-SENSOR_HEIGHT);
    for (x, y) in steps(5.0, 7.0).flat_map(|x| steps(-0.5, 0.5).map(move |y| (x, y))) {
        column(&mut voxels, x, y, -SENSOR_HEIGHT - 4.0, |_| false);
        voxels.extend(steps(-1.5, 1.0).map(|z| voxel(x, y, z, FREE_VALUE, voxel_flags::KNOWN)));
    }
    let mut bench = Bench::new();
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    assert_eq!(bench.plan().at(6.05, 0.05), UNKNOWN);
}

#[test]
fn without_any_ground_the_band_hangs_on_the_path() {
    let voxels: Vec<_> =
        room(-SENSOR_HEIGHT).into_iter().map(|voxel| Voxel { flags: voxel_flags::KNOWN, ..voxel }).collect();
    let mut bench = Bench::with(|config| config.sensor_height_m = SENSOR_HEIGHT);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    let plan = bench.plan();
    assert_eq!(plan.at(2.05, 0.05), FREE);
    assert_eq!(plan.at(-0.95, 0.05), OCCUPIED);
    // With the sensor taken for 4 m high the band lies below the room.
    let mut bench = Bench::with(|config| config.sensor_height_m = 4.0);
    bench.walk([0.0; 3], [4.0, 0.0, 0.0], &voxels);
    assert_eq!(bench.plan().count(OCCUPIED), 0);
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
