//! temporary harness: raw scans -> lio (own deskew)
use evac_frames::{ImuSample, Point, PoseFrame, ScanHeader};
use evac_odometry::*;
use evac_stage::*;
use std::io::Read;
fn rd(path: &str) -> Vec<u8> {
    let mut b = Vec::new();
    std::fs::File::open(path).unwrap().read_to_end(&mut b).unwrap();
    b
}
fn scans(path: &str) -> Vec<(ScanHeader, Vec<Point>)> {
    let b = rd(path);
    let mut i = 24;
    let mut out: Vec<(ScanHeader, Vec<Point>)> = vec![];
    while i + 16 <= b.len() {
        let n = u32::from_le_bytes(b[i + 8..i + 12].try_into().unwrap()) as usize;
        let p = &b[i + 16..i + 16 + n];
        i += 16 + n;
        let u = &p[42..];
        if u[9] != 0 {
            continue;
        }
        let ts = u64::from_le_bytes(u[10..18].try_into().unwrap()) as i64;
        let f = (ts / 100_000_000) as usize;
        while out.len() <= f {
            let k = out.len() as i64;
            let mut h = ScanHeader::default();
            h.frame.seq = k as u64;
            h.frame.start_ns = k * 100_000_000;
            h.frame.end_ns = (k + 1) * 100_000_000;
            out.push((h, vec![]));
        }
        for k in 0..(u.len() - 18) / 13 {
            let q = &u[18 + 13 * k..];
            let g = |o: usize| i32::from_le_bytes(q[o..o + 4].try_into().unwrap()) as f32 * 1e-3;
            let t = ts + (k as i64) * 10_000;
            let f2 = (t / 100_000_000) as usize;
            if f2 >= out.len() {
                break;
            }
            if g(0) == 0.0 && g(4) == 0.0 && g(8) == 0.0 {
                continue;
            }
            let s = out[f2].0.frame.start_ns;
            out[f2].1.push(Point::new(g(0), g(4), g(8), t - s, q[12]));
        }
    }
    out
}
fn imu(path: &str) -> Vec<ImuSample> {
    let b = rd(path);
    let mut out = vec![];
    let mut k = 0i64;
    let mut a = [0f64; 3];
    for c in b.chunks_exact(11) {
        let g = |o: usize| i16::from_le_bytes([c[2 + o], c[3 + o]]) as f64 / 32768.0;
        if c[1] == 0x51 {
            a = [g(0), g(2), g(4)].map(|x| x * 16.0 * 9.8);
        }
        if c[1] == 0x52 {
            let w = [g(0), g(2), g(4)].map(|x| (x * 2000.0).to_radians());
            out.push(ImuSample {
                seq: k as u64,
                stamp_ns: k * 5_000_000,
                gyro: w,
                accel: a,
                ..Default::default()
            });
            k += 1;
        }
    }
    out
}
fn main() {
    let args: Vec<String> = std::env::args().collect();
    for w in ["corridor", "hall", "shake"] {
        if args.len() > 1 && args[1] != "all" && args[1] != w {
            continue;
        }
        let dir = format!("/tmp/walks/{w}");
        let sc = scans(&format!("{dir}/lidar.pcap"));
        let mut im = imu(&format!("{dir}/wt901c.bin"));
        let opt = |k: &str| -> Option<f64> {
            args.iter().find_map(|a| a.strip_prefix(&format!("{k}=")).map(|v| v.parse().unwrap()))
        };
        if args.iter().any(|a| a == "zero") {
            let n = opt("zt").map_or(370, |t| (t * 200.0) as usize);
            for s in im.iter_mut().take(n) {
                s.gyro = [0.0; 3];
            }
        }
        if let Some(o) = opt("off") {
            for s in im.iter_mut() {
                s.stamp_ns += (o * 1e6) as i64;
            }
        }
        if let Some(g) = opt("gap") {
            im.retain(|s| s.stamp_ns < 4_000_000_000 || s.stamp_ns % 7_300_000_000 > (g * 1e6) as i64);
        }
        if let Some(g) = opt("scale") {
            for s in im.iter_mut() {
                s.gyro = s.gyro.map(|x| x * (1.0 + g));
            }
        }
        let mut sc = sc;
        if let Some(g) = opt("ldrop") {
            sc.retain(|(h, _)| {
                h.frame.end_ns < 4_000_000_000 || h.frame.end_ns % 6_000_000_000 > (g * 1e6) as i64
            });
        }
        if let Some(g) = opt("lblind") {
            for (h, p) in sc.iter_mut() {
                if h.frame.end_ns > 4_000_000_000 && h.frame.end_ns % 6_000_000_000 <= (g * 1e6) as i64 {
                    p.clear();
                }
            }
        }
        if let Some(g) = opt("skip") {
            let t0 = (g * 1e9) as i64;
            sc.retain(|(h, _)| h.frame.start_ns >= t0);
            im.retain(|s| s.stamp_ns >= t0);
        }
        if let Some(g) = opt("half") {
            if g > 0.0 {
                im.retain(|s| s.seq % 2 == 0);
            }
        }
        if let Some(g) = opt("rough") {
            let mut x = 1u64;
            for (_, p) in sc.iter_mut() {
                for q in p.iter_mut() {
                    x = x.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    let u = ((x >> 33) as f64 / (1u64 << 31) as f64 - 0.5) * 2.0 * g;
                    let r = ((q.x * q.x + q.y * q.y + q.z * q.z) as f64).sqrt();
                    let k = (1.0 + u / r) as f32;
                    *q = q.moved_to(q.x * k, q.y * k, q.z * k);
                }
            }
        }
        if let Some(g) = opt("kick") {
            let mut last = 0i64;
            for s in im.iter_mut() {
                if s.stamp_ns > 15_000_000_000 && s.stamp_ns < 15_300_000_000 {
                    s.accel = [g, 0.0, 9.8];
                    last = s.stamp_ns;
                }
            }
            let _ = last;
        }
        let xr = opt("xrot").unwrap_or(0.0);
        let mut rig = match w {
            "corridor" => Rig { imu_from_lidar: serde_rig([0.05, -0.02, 0.06], [0.5, -1.0, 1.5]) },
            "hall" => Rig { imu_from_lidar: serde_rig([0.02, 0.0, 0.05], [0.0; 3]) },
            _ => Rig::default(),
        };
        rig.imu_from_lidar.roll_pitch_yaw_deg =
            rig.imu_from_lidar.roll_pitch_yaw_deg.map(|x| x + xr / 3f64.sqrt());
        let cfg: LioConfig =
            std::env::var("LIO").ok().map(|t| toml::from_str(&t).unwrap()).unwrap_or_default();
        let mut lio = Lio::new(cfg, &rig).unwrap();
        let mut out = PoseOutput::default();
        let mut c = Counters::default();
        let mut prev = i64::MIN;
        let mut ms = vec![];
        for (h, p) in &sc {
            let a = im.partition_point(|s| s.stamp_ns <= prev).saturating_sub(1);
            let b = (im.partition_point(|s| s.stamp_ns < h.frame.end_ns) + 1).min(im.len());
            let t = std::time::Instant::now();
            lio.process(
                ScanWithImu { header: h, points: p, imu: &im[a..b], imu_covers: true, prior: None },
                &mut out,
                &mut c,
            )
            .unwrap();
            ms.push(t.elapsed().as_secs_f64() * 1e3);
            prev = h.frame.end_ns;
            if args.iter().any(|a| a == "v") {
                let q = out.memory.last().unwrap();
                println!(
                    "{} {:.3?} td {:.2} v {:.2?} bg {:.4?} ba {:.3?} q {:.2} deg {} st {} nis {:.3} sd {:.4}",
                    h.frame.seq,
                    q.position,
                    q.time_offset_ns as f64 * 1e-6,
                    q.velocity,
                    q.gyro_bias,
                    q.accel_bias,
                    q.quality,
                    q.degenerate,
                    q.state,
                    lio.diagnostics().nis,
                    (q.covariance[0] + q.covariance[7] + q.covariance[14]).sqrt()
                );
            }
        }
        let gt: Vec<[f64; 8]> = std::fs::read_to_string(format!("/work/shared/data/simulated/{w}/gt.tum"))
            .unwrap()
            .lines()
            .map(|l| {
                let v: Vec<f64> = l.split_whitespace().map(|x| x.parse().unwrap()).collect();
                v.try_into().unwrap()
            })
            .collect();
        eval(w, &gt, &out.memory, &mut ms, lio.diagnostics());
    }
}
fn serde_rig(t: [f64; 3], r: [f64; 3]) -> evac_config::ImuFromLidar {
    evac_config::ImuFromLidar { translation_m: t, roll_pitch_yaw_deg: r }
}
use evac_geometry::nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
fn eval(w: &str, gt: &[[f64; 8]], est: &[PoseFrame], ms: &mut Vec<f64>, d: &Diagnostics) {
    let gt: Vec<[f64; 8]> = est.iter().filter_map(|p| gt.get(p.frame.seq as usize).copied()).collect();
    let gt = &gt[..];
    let n = gt.len().min(est.len());
    let g: Vec<Vector3<f64>> = gt.iter().map(|v| Vector3::new(v[1], v[2], v[3])).collect();
    let e: Vec<Vector3<f64>> = est.iter().map(|p| Vector3::from(p.position)).collect();
    let gm = g[..n].iter().sum::<Vector3<f64>>() / n as f64;
    let em = e[..n].iter().sum::<Vector3<f64>>() / n as f64;
    let mut h = Matrix3::zeros();
    for i in 0..n {
        h += (e[i] - em) * (g[i] - gm).transpose();
    }
    let s = h.svd(true, true);
    let (u, vt) = (s.u.unwrap(), s.v_t.unwrap());
    let mut dd = Matrix3::identity();
    if (vt.transpose() * u.transpose()).determinant() < 0.0 {
        dd[(2, 2)] = -1.0;
    }
    let r = vt.transpose() * dd * u.transpose();
    let errs: Vec<f64> = (0..n).map(|i| (r * (e[i] - em) + gm - g[i]).norm()).collect();
    let ape = (errs.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt();
    if n < 10 {
        return;
    }
    let path: f64 = (1..n).map(|i| (g[i] - g[i - 1]).norm()).sum();
    let gq =
        |i: usize| UnitQuaternion::from_quaternion(Quaternion::new(gt[i][7], gt[i][4], gt[i][5], gt[i][6]));
    let eq = |i: usize| {
        let o = est[i].orientation;
        UnitQuaternion::from_quaternion(Quaternion::new(o[3], o[0], o[1], o[2]))
    };
    // end drift relative to first tracked pose
    let i0 = est.iter().position(|p| p.state != 0).unwrap_or(0);
    let rel = |q0: UnitQuaternion<f64>, p0: Vector3<f64>, q: UnitQuaternion<f64>, p: Vector3<f64>| {
        (q0.inverse() * (p - p0), q0.inverse() * q)
    };
    let (pg, qg) = rel(gq(i0), g[i0], gq(n - 1), g[n - 1]);
    let (pe, qe) = rel(eq(i0), e[i0], eq(n - 1), e[n - 1]);
    let drift = (pg - pe).norm();
    let rot = (qg.inverse() * qe).angle().to_degrees();
    ms.sort_by(f64::total_cmp);
    let honest = (i0..n)
        .filter(|&i| {
            let err = (r * (e[i] - em) + gm - g[i]).norm();
            let c = &est[i].covariance;
            err < 3.0 * (c[0] + c[7] + c[14]).sqrt()
        })
        .count() as f64
        / (n - i0) as f64;
    println!(
        "{w:8} path {path:.1} ape {ape:.4} max {:.4} drift {drift:.3} m {:.3}% rot {rot:.3} ms med {:.2} p99 {:.2} max {:.1} honest {honest:.2} states lost {} deg {} start {i0} loss {} restart {} nis {:.2} gaps {} cells {}",
        errs.iter().cloned().fold(0.0, f64::max),
        100.0 * drift / path,
        ms[ms.len() / 2],
        ms[ms.len() * 99 / 100],
        ms[ms.len() - 1],
        est.iter().filter(|p| p.state == 3).count(),
        est.iter().filter(|p| p.state == 2).count(),
        d.losses,
        d.map_restarts,
        d.nis,
        d.imu_gaps,
        d.map_cells
    );
}
