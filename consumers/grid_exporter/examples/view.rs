#![allow(missing_docs)]
use evac_frames::*;
use evac_grid_exporter::*;
use evac_stage::*;
use std::collections::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let res: f64 = args[2].parse().unwrap();
    let mut config = GridExporterConfig::default();
    config.output_dir = args[1].clone().into();
    let mut stage = GridExporter::new(config, &Rig::default()).unwrap();
    let mut out = GridOutput::default();
    let mut c = Counters::default();
    // corridor loop 13 x 9, width 2, rooms outside with doors
    let solid = |x: f64, y: f64| -> bool {
        let inside = |x0: f64, y0: f64, x1: f64, y1: f64| x > x0 && x < x1 && y > y0 && y < y1;
        let corridor = inside(0.0, 0.0, 15.0, 11.0) && !inside(2.0, 2.0, 13.0, 9.0);
        let door =
            inside(5.0, -0.3, 6.0, 0.1) || inside(14.9, 4.0, 15.3, 5.0) || inside(7.0, 10.9, 8.0, 11.3);
        let room =
            inside(3.0, -4.0, 9.0, -0.2) || inside(15.2, 2.0, 19.0, 8.0) || inside(5.0, 11.2, 12.0, 15.0);
        let boxy = inside(9.0, 0.0, 9.6, 0.5) || inside(1.5, 6.0, 2.0, 7.0) || inside(16.5, 5.5, 17.5, 6.5);
        boxy || !(corridor || door || room)
    };
    let mut path: Vec<(f64, f64, f64)> = vec![];
    let corners: [(f64, f64); 5] = [(1.0, 1.0), (14.0, 1.0), (14.0, 10.0), (1.0, 10.0), (1.0, 1.3)];
    for w in corners.windows(2) {
        let (dx, dy) = (w[1].0 - w[0].0, w[1].1 - w[0].1);
        let l = dx.hypot(dy);
        let h = dy.atan2(dx);
        if let Some(p) = path.last().copied() {
            let mut d = h - p.2;
            while d > 3.2 {
                d -= 6.2832
            }
            while d < -3.2 {
                d += 6.2832
            }
            for i in 1..=20 {
                path.push((p.0, p.1, p.2 + d * i as f64 / 20.0));
            }
        }
        for i in 0..=(l / 0.1) as i32 {
            let s = i as f64 * 0.1 / l;
            path.push((w[0].0 + dx * s, w[0].1 + dy * s, h));
        }
    }
    let n = path.len();
    for (k, (px, py, h)) in path.into_iter().enumerate() {
        let mut map: BTreeMap<[u16; 3], Voxel> = BTreeMap::new();
        let key = |x: f64, y: f64, z: f64| [x, y, z].map(|a| ((a / res).floor() as i32 + 32768) as u16);
        if k % 3 == 0 || k == n - 1 {
            for i in -100..=100 {
                let a = h + i as f64 * 0.00335;
                let mut d = 0.3;
                while d < 25.0 {
                    let (x, y) = (px + d * a.cos(), py + d * a.sin());
                    let v = 0.348 * d;
                    let s = solid(x, y);
                    if 1.2 < v && !s {
                        map.insert(
                            key(x - 1.0, y - 1.0, -1.2 + 0.5 * res),
                            Voxel { key: key(x - 1.0, y - 1.0, -1.2 + 0.5 * res), flags: 3, log_odds: -1.0 },
                        );
                    }
                    let mut z = -1.2 + 1.5 * res;
                    while z < 1.2 {
                        if z.abs() < v {
                            let kk = key(x - 1.0, y - 1.0, z);
                            let lo = if s { 1.0 } else { -1.0 };
                            if s || !map.contains_key(&kk) {
                                map.insert(kk, Voxel { key: kk, flags: 2, log_odds: lo });
                            }
                        }
                        z += res;
                    }
                    if s {
                        break;
                    }
                    d += res * 0.45;
                }
            }
        }
        let voxels: Vec<Voxel> = map.into_values().collect();
        let frame = FrameHeader {
            seq: k as u64,
            end_ns: k as i64 * 100_000_000,
            flags: u32::from(k == n - 1),
            ..Default::default()
        };
        let header =
            MapHeader { frame, resolution: res, position: [px - 1.0, py - 1.0, 0.0], ..Default::default() };
        let pose = PoseFrame { frame, position: [px - 1.0, py - 1.0, 0.0], ..Default::default() };
        stage
            .process(
                PlanInput { map: MapMessage { header: &header, voxels: &voxels }, pose: &pose },
                &mut out,
                &mut c,
            )
            .unwrap();
    }
    stage.finish().unwrap();
    println!("{:?} {} plans", c, out.memory.len());
}
