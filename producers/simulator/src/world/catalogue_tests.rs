//! Every walk of the catalogue is one that a person could have made.

use evac_geometry::log_so3;
use evac_geometry::nalgebra::Vector3;

use super::*;
use crate::catalogue::{CatalogueWalk, Group, catalogue};
use crate::random::Random;
use crate::trajectory::{Gait, Motion, Trajectory};

/// No LiDAR of the catalogue comes nearer to anything, metres.
const CLEAR: f64 = 0.35;

struct Walked {
    walk: CatalogueWalk,
    world: World,
    trajectory: Trajectory,
}

impl Walked {
    fn new(walk: CatalogueWalk) -> Self {
        let config = &walk.config;
        let (world, route) = World::build(config).unwrap();
        let gait = Gait::new(config.gait, &mut Random::new(config.seed, 0));
        let trajectory = Trajectory::new(route, gait, config.mount_tilt_deg.map(f64::to_radians));
        Self { walk, world, trajectory }
    }

    fn motions(&self, every_s: f64) -> impl Iterator<Item = (f64, Motion)> {
        let count = (self.trajectory.duration_s() / every_s) as u32;
        (0..=count).map(move |k| f64::from(k) * every_s).map(|t| (t, self.trajectory.at(t)))
    }

    fn world_from_lidar(&self, motion: &Motion) -> evac_geometry::nalgebra::Isometry3<f64> {
        motion.world_from_imu * self.walk.rig.imu_from_lidar()
    }
}

/// Series 0 and the one that nothing was tuned on.
fn all() -> Vec<Walked> {
    [0, 1].into_iter().flat_map(catalogue).map(Walked::new).collect()
}

#[test]
fn the_lidar_keeps_clear_of_everything_and_is_never_inside_anything() {
    for walked in all() {
        let name = &walked.walk.name;
        for (t, motion) in walked.motions(0.5) {
            let place = walked.world_from_lidar(&motion).translation.vector;
            for solid in walked.world.bvh.solids() {
                let clear = solid.distance(&place);
                assert!(clear >= CLEAR, "{name} at {t} s, {place:?}: {clear} m from {solid:?}");
            }
            if let Some(cavern) = &walked.world.cavern {
                assert!(cavern.depth(&place) >= CLEAR, "{name} at {t} s: {} m", cavern.depth(&place));
            }
            for person in &walked.world.people {
                let [x, y] = person.at(t);
                let away = (x - place.x).hypot(y - place.y);
                assert!(away > 0.6, "{name} at {t} s: somebody {away} m away");
            }
        }
    }
}

#[test]
fn the_gyroscope_sees_every_turn() {
    let h = 0.005;
    for walked in all() {
        let motions: Vec<_> = walked.motions(h).collect();
        for pair in motions.windows(2) {
            let [(_, a), (t, b)] = pair else { continue };
            let turned = log_so3(&(a.world_from_imu.rotation.inverse() * b.world_from_imu.rotation));
            let seen = (a.angular_velocity + b.angular_velocity) * (h / 2.0);
            let hidden = (turned - seen).norm().to_degrees();
            assert!(hidden < 0.01, "{} at {t} s: {hidden} degrees in one sample", walked.walk.name);
        }
    }
}

#[test]
fn people_walk_through_nothing() {
    for walked in all() {
        for person in &walked.world.people {
            for k in 0..300 {
                let [x, y] = person.at(f64::from(k) * 0.2);
                let chest = Vector3::new(x, y, 1.0);
                let clear = |solid: &Solid| solid.distance(&chest);
                let least = walked.world.bvh.solids().iter().map(clear).fold(f64::MAX, f64::min);
                assert!(least > 0.2, "{}: {least} m at ({x}, {y})", walked.walk.name);
            }
        }
    }
}

#[test]
fn most_shots_come_back_but_for_glass() {
    for walked in all() {
        let name = &walked.walk.name;
        let (mut shots, mut returns) = (0.0, 0.0);
        for (t, motion) in walked.motions(2.0) {
            let pose = walked.world_from_lidar(&motion);
            let (mut here, mut back) = (0.0, 0.0);
            for shot in 0..200 {
                let beam = pose.rotation * crate::mid40::direction(shot * 511);
                let ray = Ray::new(pose.translation.vector, beam);
                here += 1.0;
                back += walked.world.cast(&ray, &[], 90.0).map_or(0.0, |(_, material)| material.returns());
            }
            let glass = walked.walk.config.world == WorldKind::Atrium;
            assert!(glass || back / here > 0.35, "{name} at {t} s: {} of the shots come back", back / here);
            shots += here;
            returns += back;
        }
        assert!(returns / shots > 0.6, "{name}: {} of the shots come back", returns / shots);
    }
}

#[test]
fn walks_begin_with_three_seconds_of_standing_and_are_of_the_length_that_was_wanted() {
    for walked in all() {
        let name = &walked.walk.name;
        for k in 0..30 {
            assert_eq!(walked.trajectory.at(f64::from(k) * 0.1).velocity, Vector3::zeros(), "{name}");
        }
        let places: Vec<Vector3<f64>> =
            walked.motions(0.1).map(|(_, motion)| motion.world_from_imu.translation.vector).collect();
        let way: f64 = places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let seconds = walked.trajectory.duration_s();
        assert!(
            (28.0..85.0).contains(&way) && (35.0..100.0).contains(&seconds),
            "{name}: {way} m, {seconds} s"
        );
    }
}

#[test]
fn both_groups_have_ten_walks_a_series_with_their_own_names_seeds_and_half_of_them_zeroed_gyros() {
    let walks: Vec<_> = [0, 1].into_iter().flat_map(catalogue).collect();
    for group in [Group::Boxes, Group::Rough] {
        let of_group: Vec<&CatalogueWalk> = walks.iter().filter(|walk| walk.group == group).collect();
        let zeroed = of_group.iter().filter(|walk| walk.config.auto_zero).count();
        assert!(of_group.len() >= 20, "{group:?}: {}", of_group.len());
        assert!(zeroed.abs_diff(of_group.len() - zeroed) <= 2, "{group:?}: {zeroed} zeroed");
    }
    let distinct = |key: fn(&CatalogueWalk) -> String| {
        walks.iter().map(key).collect::<std::collections::BTreeSet<_>>().len()
    };
    assert_eq!(distinct(|walk| walk.name.clone()), walks.len());
    assert_eq!(distinct(|walk| walk.config.seed.to_string()), walks.len());
    let building = |walk: &CatalogueWalk| format!("{:?} {}", walk.config.world, walk.config.building);
    assert_eq!(distinct(building), walks.len());
}
