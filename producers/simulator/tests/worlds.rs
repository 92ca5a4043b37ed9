//! Worlds beside the three first ones, seen through the sensors.

// Clippy's exception for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use evac_frames::Point;
use evac_simulator::{Config, Frame, Group, WorldKind, semi_real, simulate};
use evac_stage::Rig;

const DRAWN: [WorldKind; 10] = [
    WorldKind::FloorPlan,
    WorldKind::Rough,
    WorldKind::Tunnel,
    WorldKind::Plant,
    WorldKind::Office,
    WorldKind::Atrium,
    WorldKind::OpenHall,
    WorldKind::Ramp,
    WorldKind::Shaft,
    WorldKind::Corridor,
];

fn frames(config: &Config, count: usize) -> Vec<Frame> {
    simulate(config, &Rig::default()).unwrap().take(count).collect()
}

fn ranges(frame: &Frame) -> impl Iterator<Item = f64> {
    let range = |p: &Point| f64::from(p.x).hypot(f64::from(p.y)).hypot(f64::from(p.z));
    frame.points.iter().map(range)
}

#[test]
fn the_same_building_and_seed_give_equal_frames_and_another_building_others() {
    for world in DRAWN {
        let drawn = |building| frames(&Config { world, building, seed: 3, ..Config::default() }, 2);
        let (a, b, other) = (drawn(5), drawn(5), drawn(6));
        for (a, b) in a.iter().zip(&b) {
            assert!(a.points == b.points && a.imu == b.imu && a.truth == b.truth, "{world:?}");
        }
        let differs = a.iter().zip(&other).all(|(a, b)| a.points != b.points);
        assert_eq!(differs, world != WorldKind::Corridor, "{world:?}");
    }
}

#[test]
fn roughness_moves_the_surfaces_by_centimetres_and_nothing_else() {
    let quiet =
        Config { range_noise_m: 0.0, drop_out_share: 0.0, stray_share: 0.0, seed: 2, ..Config::default() };
    let smooth = frames(&quiet, 1);
    let rough = frames(&Config { roughness_m: Some(0.01), ..quiet }, 1);
    assert_eq!((&smooth[0].imu, smooth[0].truth), (&rough[0].imu, rough[0].truth));
    let mut off: Vec<f64> = ranges(&smooth[0]).zip(ranges(&rough[0])).map(|(a, b)| (a - b).abs()).collect();
    off.sort_by(f64::total_cmp);
    let (half, most) = (off[off.len() / 2], off[off.len() * 9 / 10]);
    // Along the beam, which mostly grazes the walls of a corridor.
    assert!(
        half > 0.003 && half < 0.05 && most < 0.3,
        "half of the shots within {half} m, 90 % within {most} m"
    );
}

#[test]
fn the_measured_hall_is_walked_through_where_its_map_is_at_hand() {
    let Some(folder) = evac_testkit::data("real/livox_mid40_hall_map") else { return };
    let walks = semi_real(&folder, 0);
    assert_eq!(walks.len(), 2);
    let walk = &walks[0];
    assert_eq!(walk.group, Group::SemiReal);
    let first = simulate(&walk.config, &walk.rig).unwrap().next().unwrap();
    let returns = first.points.iter().filter(|point| point.is_return()).count();
    assert!(returns > 9000, "{returns} returns");
    let far = ranges(&first).filter(|range| *range > 20.0).count();
    assert!(far > 500, "{far} shots see farther than 20 m down the hall");
    assert!(semi_real(&folder.join("nowhere"), 0).is_empty());
}
