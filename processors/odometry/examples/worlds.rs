//! temporary
#[path = "../tests/common/mod.rs"]
mod common;
use common::*;
use evac_geometry::map_from_lidar;
use evac_simulator::*;
use evac_stage::Rig;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let cfg: evac_odometry::LioConfig =
        std::env::var("LIO").ok().map(|t| toml::from_str(&t).unwrap()).unwrap_or_default();
    let base: Config = a.get(1).map(|t| toml::from_str(t).unwrap()).unwrap_or_default();
    let (s0, s1) = (a.get(2).map_or(1, |x| x.parse().unwrap()), a.get(3).map_or(5, |x| x.parse().unwrap()));
    for w in [WorldKind::Corridor, WorldKind::Hall, WorldKind::Stairwell] {
        for seed in s0..s1 {
            let rig = Rig {
                imu_from_lidar: evac_config::ImuFromLidar {
                    translation_m: [0.05, -0.02, 0.06],
                    roll_pitch_yaw_deg: [0.5, -1.0, 1.5],
                },
            };
            let mut p = Pipeline::with(cfg, &rig);
            let mut t = vec![];
            for f in simulate(&Config { world: w, seed, ..base.clone() }, &rig).unwrap() {
                let q = p.feed(&f.header, &f.points, &f.imu);
                t.push(map_from_lidar(&f.truth));
                if a.len() > 4 {
                    let e = (map_from_lidar(&f.truth).translation.vector
                        - map_from_lidar(&q).translation.vector)
                        .norm();
                    println!(
                        "{} err {e:.3} {:.2?} v {:.2?} bg {:.4?} ba {:.3?} td {:.2} q {:.2} deg {} st {} nis {:.2}",
                        f.header.frame.seq,
                        q.position,
                        q.velocity,
                        q.gyro_bias,
                        q.accel_bias,
                        q.time_offset_ns as f64 * 1e-6,
                        q.quality,
                        q.degenerate,
                        q.state,
                        p.lio.diagnostics().nis
                    );
                }
            }
            let f = Figures::of(p.trajectory(), &t);
            println!(
                "{w:?} {seed}: ape {:.3} max {:.3} drift {:.3}% rot {:.3} honest {:.2} lost {} losses {} ms {:.2?} cells {}",
                f.ape,
                f.ape_max,
                f.drift_percent(),
                f.rotation_deg,
                f.honest,
                f.lost,
                p.lio.diagnostics().losses,
                percentiles(&p.milliseconds),
                p.lio.diagnostics().map_cells
            );
        }
    }
}
