use evac_geometry::nalgebra::Vector3;

use super::*;
use crate::random::Random;
use crate::trajectory::{Gait, Trajectory};

fn walk(world: WorldKind) -> (World, Trajectory) {
    let config = Config { world, ..Config::default() };
    let (world, route) = World::build(&config).unwrap();
    (world, Trajectory::new(route, Gait::new(1.0, &mut Random::new(1, 0)), [0.0; 2]))
}

const KINDS: [WorldKind; 3] = [WorldKind::Corridor, WorldKind::Hall, WorldKind::Stairwell];

#[test]
fn the_walker_keeps_clear_of_walls_and_things() {
    for kind in KINDS {
        let (world, walk) = walk(kind);
        for k in 0..(walk.duration_s() * 50.0) as u32 {
            let t = f64::from(k) * 0.02;
            let rig = walk.at(t).world_from_imu.translation.vector;
            // The rig itself, and the walker's head above and hips below it.
            for dz in [-0.6, -0.3, 0.0, 0.5] {
                let place = rig + Vector3::z() * dz;
                for solid in world.bvh.solids() {
                    let clear = solid.distance(&place);
                    assert!(clear > 0.2, "{kind:?} at {t:.2} s, {place:?}: {clear} m from {solid:?}");
                }
            }
        }
    }
}

#[test]
fn people_keep_clear_of_things_and_of_the_walker() {
    for kind in KINDS {
        let (world, walk) = walk(kind);
        for k in 0..(walk.duration_s() * 20.0) as u32 {
            let t = f64::from(k) * 0.05;
            let rig = walk.at(t).world_from_imu.translation.vector;
            for (index, person) in world.people.iter().enumerate() {
                let [x, y] = person.at(t);
                let away = (x - rig.x).hypot(y - rig.y);
                assert!(away > 0.6, "{kind:?}: person {index} is {away} m from the walker at {t} s");
                let chest = Vector3::new(x, y, 1.0);
                let clear = world.bvh.solids().iter().map(|s| s.distance(&chest)).fold(f64::MAX, f64::min);
                assert!(
                    clear > 0.2,
                    "{kind:?}: person {index} is {clear} m from a thing at {t} s ({x}, {y})"
                );
            }
        }
    }
}

#[test]
fn every_ray_from_the_route_ends_somewhere_in_the_building() {
    for kind in KINDS {
        let (world, walk) = walk(kind);
        let mut random = Random::new(2, 0);
        for _ in 0..20_000 {
            let origin = walk.at(random.uniform() * walk.duration_s()).world_from_imu.translation.vector;
            let direction = Vector3::from(random.normals()).normalize();
            let hit = world.cast(&Ray::new(origin, direction), &[], 60.0);
            assert!(hit.is_some(), "{kind:?}: a ray from {origin:?} along {direction:?} leaves the building");
        }
    }
}

#[test]
fn people_move_and_the_ray_that_met_one_meets_the_floor_a_moment_later() {
    let (world, _) = walk(WorldKind::Hall);
    assert!(world.people.len() >= 4);
    for person in &world.people {
        let [x, y] = person.at(10.0);
        let down = Ray::new(Vector3::new(x, y, 2.5), Vector3::new(1e-6, 1e-6, -1.0).normalize());
        let mut shapes = Vec::new();
        world.people_at(10.0, &mut shapes);
        let (range, material) = world.cast(&down, &shapes, 60.0).unwrap();
        assert!((range - (2.5 - 1.76)).abs() < 1e-6 && material == Material::Cloth, "{range} m");
        world.people_at(12.0, &mut shapes);
        let (range, material) = world.cast(&down, &shapes, 60.0).unwrap();
        assert!((range - 2.5).abs() < 1e-6 && material == Material::Concrete, "{range} m");
    }
}
