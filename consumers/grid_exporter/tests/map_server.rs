//! `plan.yaml` and its picture, read by the rules that nav2 and ROS 1 document, written down here once more: nothing of our own
//! reader is used.
#![allow(clippy::unwrap_used)]

use std::collections::HashMap;
use std::path::Path;

use evac_frames::{FrameHeader, MapHeader, PoseFrame, TrackingState, Voxel, voxel_flags};
use evac_grid_exporter::{GridExporter, GridExporterConfig, Mode};
use evac_stage::{Counters, GridOutput, MapMessage, PlanInput, Rig, Stage};

const RESOLUTION: f64 = 0.05;
/// Metres: far from any symmetry, and with origins of both signs.
const LOW: [f64; 2] = [-7.35, 2.10];

/// A room of 4 x 3 m from [`LOW`] with an F of pillars in it, which no mirror and no turn maps on itself, and a corner that was
/// never seen.
fn cell(x: i32, y: i32) -> Option<bool> {
    let (wall, unseen) = (x == 0 || y == 0 || x == 79 || y == 59, x > 60 && y > 40);
    let stem = (20..24).contains(&x) && (10..50).contains(&y);
    let arms =
        (24..40).contains(&x) && (46..50).contains(&y) || (24..34).contains(&x) && (30..34).contains(&y);
    (!unseen).then_some(wall || stem || arms)
}

fn export(mode: Mode) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let config =
        GridExporterConfig { output_dir: folder.path().to_owned(), mode, ..GridExporterConfig::default() };
    let mut stage = GridExporter::new(config, &Rig::default()).unwrap();
    let mut voxels = Vec::new();
    let first = LOW.map(|axis| (axis / RESOLUTION).round() as i32);
    for (x, y) in (0..80).flat_map(|x| (0..60).map(move |y| (x, y))) {
        let Some(occupied) = cell(x, y) else { continue };
        for z in 0..40 {
            let key = [first[0] + x, first[1] + y, z - 24].map(|axis| (axis + 32_768) as u16);
            let ground = if z == 0 && !occupied { voxel_flags::GROUND } else { 0 };
            let log_odds = if occupied { 2.0 } else { -1.0 };
            voxels.push(Voxel { key, flags: voxel_flags::KNOWN | ground, log_odds });
        }
    }
    for step in 0..20 {
        let frame = FrameHeader { seq: step, end_ns: step as i64 * 100_000_000, ..FrameHeader::default() };
        let position = [LOW[0] + 0.5 + 0.1 * step as f64 / 4.0, LOW[1] + 0.5, 0.0];
        let header = MapHeader { frame, resolution: RESOLUTION, position, ..MapHeader::default() };
        let pose =
            PoseFrame { frame, position, state: TrackingState::Tracking as u32, ..PoseFrame::default() };
        let news = if step == 0 { &voxels[..] } else { &[] };
        let input = PlanInput { map: MapMessage { header: &header, voxels: news }, pose: &pose };
        stage.process(input, &mut GridOutput::default(), &mut Counters::default()).unwrap();
    }
    stage.finish().unwrap();
    folder
}

/// The keys of a map file.
fn yaml(path: &Path) -> HashMap<String, String> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let pair = |line: &str| line.split_once(": ").map(|(key, value)| (key.to_owned(), value.to_owned()));
    lines.map(|line| pair(line).unwrap()).collect()
}

/// Width, height and pixels of a binary PGM with one comment, row 0 at the top.
fn pgm(path: &Path) -> (usize, usize, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let lines: Vec<&[u8]> = bytes.splitn(5, |byte| *byte == b'\n').collect();
    assert!(lines[0] == b"P5" && lines[1][0] == b'#' && lines[3] == b"255");
    let size: Vec<usize> =
        String::from_utf8_lossy(lines[2]).split(' ').map(|word| word.parse().unwrap()).collect();
    assert_eq!(lines[4].len(), size[0] * size[1]);
    (size[0], size[1], lines[4].to_vec())
}

/// An occupancy grid as a subscriber gets it: cells by the coordinates of their centres.
struct Message {
    origin: [f64; 3],
    resolution: f64,
    width: usize,
    data: Vec<i8>,
}

impl Message {
    /// `nav2_map_server`, `map_io.cpp`, as its documentation of the YAML states it.
    fn by_nav2(folder: &Path) -> Self {
        let keys = yaml(&folder.join("plan.yaml"));
        let (width, height, pixels) = pgm(&folder.join(&keys["image"]));
        let number = |key: &str, default: f64| keys.get(key).map_or(default, |value| value.parse().unwrap());
        let (occupied, free) = (number("occupied_thresh", 0.65), number("free_thresh", 0.25));
        let negate = keys.get("negate").is_some_and(|value| value == "1");
        let mut data = vec![0; width * height];
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let shade = f64::from(pixels[y * width + x]) / 255.0;
            let occupancy = if negate { shade } else { 1.0 - shade };
            data[width * (height - y - 1) + x] = match keys.get("mode").map(String::as_str) {
                Some("raw") => {
                    let value = (shade * 255.0).round();
                    if (0.0..=100.0).contains(&value) { value as i8 } else { -1 }
                }
                None | Some("trinary") if occupied < occupancy => 100,
                None | Some("trinary") if occupancy < free => 0,
                None | Some("trinary") => -1,
                Some(other) => unreachable!("{other}"),
            };
        }
        Self::new(&keys, width, data)
    }

    /// ROS 1 `map_server`, `image_loader.cpp`: integers, and no key may be missing.
    fn by_ros1(folder: &Path) -> Self {
        let keys = yaml(&folder.join("plan.yaml"));
        let (width, height, pixels) = pgm(&folder.join(&keys["image"]));
        let (occupied, free): (f64, f64) =
            (keys["occupied_thresh"].parse().unwrap(), keys["free_thresh"].parse().unwrap());
        let negate = keys["negate"].parse::<i32>().unwrap() != 0;
        let raw = keys.get("mode").is_some_and(|mode| mode == "raw");
        let cell = |row: usize, column: usize| {
            let colour = i32::from(pixels[row * width + column]);
            let colour = if negate { 255 - colour } else { colour };
            if raw {
                return if colour > 100 { -1 } else { colour as i8 };
            }
            let occupancy = f64::from(255 - colour) / 255.0;
            if occupancy > occupied {
                100
            } else if occupancy < free {
                0
            } else {
                -1
            }
        };
        let data =
            (0..height).flat_map(|j| (0..width).map(move |i| (height - 1 - j, i))).map(|(j, i)| cell(j, i));
        Self::new(&keys, width, data.collect())
    }

    fn new(keys: &HashMap<String, String>, width: usize, data: Vec<i8>) -> Self {
        let origin = keys["origin"].trim_matches(['[', ']']).split(", ").map(|word| word.parse().unwrap());
        let origin: Vec<f64> = origin.collect();
        Self {
            origin: [origin[0], origin[1], origin[2]],
            resolution: keys["resolution"].parse().unwrap(),
            width,
            data,
        }
    }

    /// What `nav_msgs/OccupancyGrid` says about a place: the origin is the corner of cell (0, 0).
    fn at(&self, x: f64, y: f64) -> i8 {
        let column = ((x - self.origin[0]) / self.resolution).floor() as usize;
        let row = ((y - self.origin[1]) / self.resolution).floor() as usize;
        self.data[row * self.width + column]
    }

    /// Compares with what was built, a millimetre inside the corners of every cell.
    fn check(&self, name: &str) {
        assert_eq!(self.origin[2], 0.0, "{name}: yaw");
        let mut counts = [0; 3];
        for (x, y) in (0..80).flat_map(|x| (0..60).map(move |y| (x, y))) {
            let (expected, kind) = match cell(x, y) {
                Some(true) => (100, 0),
                Some(false) => (0, 1),
                None => (-1, 2),
            };
            counts[kind] += 1;
            for inside in [
                [0.001, 0.001],
                [RESOLUTION - 0.001, 0.001],
                [0.001, RESOLUTION - 0.001],
                [RESOLUTION - 0.001; 2],
            ] {
                let cells = [x, y].map(f64::from);
                let place = [0, 1].map(|axis: usize| LOW[axis] + cells[axis] * RESOLUTION + inside[axis]);
                assert_eq!(self.at(place[0], place[1]), expected, "{name}: cell {x} {y} at {place:?}");
            }
        }
        assert!(counts.iter().all(|count| *count > 300), "{counts:?}");
        assert_eq!(
            self.data.iter().filter(|cell| **cell == 100).count(),
            counts[0],
            "{name}: nothing else is occupied"
        );
        assert_eq!(
            self.data.iter().filter(|cell| **cell == 0).count(),
            counts[1],
            "{name}: nothing else is free"
        );
    }
}

#[test]
fn nav2_and_ros_1_find_every_cell_where_it_was_built_to_the_millimetre_and_unknown_still_unknown() {
    for mode in [Mode::Trinary, Mode::Raw] {
        let folder = export(mode);
        Message::by_nav2(folder.path()).check(&format!("nav2, {mode:?}"));
        Message::by_ros1(folder.path()).check(&format!("ROS 1, {mode:?}"));
    }
}

#[test]
fn scale_mode_names_a_picture_with_transparency_as_nav2_asks_for() {
    let folder = export(Mode::Scale);
    let keys = yaml(&folder.path().join("plan.yaml"));
    assert_eq!((keys["mode"].as_str(), keys["image"].as_str()), ("scale", "plan_scale.png"));
    let ours = evac_formats::occupancy_grid::read(&folder.path().join("plan.yaml")).unwrap();
    let trinary =
        evac_formats::occupancy_grid::read(&export(Mode::Trinary).path().join("plan.yaml")).unwrap();
    assert_eq!(ours, trinary);
    // Grey with alpha, 8 bits: bytes 24 and 25 of a PNG's header.
    let png = std::fs::read(folder.path().join("plan_scale.png")).unwrap();
    assert_eq!(png[24..26], [8, 4]);
}
