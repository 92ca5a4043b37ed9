//! The ground filter against a labelled building with a ramp, a platform, a track bed, a landing and stairs, seen by a
//! sensor with a Mid-40's noise. Every point counts, also strays and a wall's lowest centimetres.

#![allow(clippy::unwrap_used)]

#[path = "common/scene.rs"]
mod scene;

use std::collections::BTreeMap;

use evac_octree_mapper::{BoundsConfig, CloudFilter, CloudFilterConfig, GroundConfig, GroundFilter, Verdict};
use scene::{Kind, Random, Scene};

/// Where the sensor goes, at 1.1 m over what it stands on.
fn path(rise: f64) -> Vec<[f64; 3]> {
    let mut path: Vec<[f64; 3]> = (0..8).map(|i| [1.0 + 2.0 * f64::from(i), 4.0, 1.1]).collect();
    path.extend([[19.0, 6.2, 0.5 * rise + 1.1], [24.0, 6.0, rise + 1.1], [27.0, 6.0, rise + 1.1]]);
    path.extend([[18.0, 2.0, 1.3 + 1.1], [20.5, 2.0, 2.04 + 1.1], [3.0, -2.0, 0.0], [12.0, -2.0, 0.0]]);
    path
}

/// Shares of correct labels by kind, and of all points.
#[derive(Default)]
struct Score {
    kinds: BTreeMap<Kind, [usize; 2]>,
    /// Of the stairs between their first and last 10 cm, which lie against a floor and the landing.
    flight: [usize; 2],
}

impl Score {
    fn add(&mut self, point: [f32; 3], kind: Kind, ground: bool) {
        let correct = usize::from(kind.is_ground() == ground);
        let counts = self.kinds.entry(kind).or_default();
        *counts = [counts[0] + correct, counts[1] + 1];
        if kind == Kind::Stairs && (0.1..1.94).contains(&point[2]) {
            self.flight = [self.flight[0] + correct, self.flight[1] + 1];
        }
    }

    fn of(&self, kinds: impl Fn(Kind) -> bool) -> f64 {
        let chosen = self.kinds.iter().filter(|(kind, _)| kinds(**kind)).map(|(_, counts)| counts);
        let [right, all] = chosen.fold([0, 0], |[r, a], [right, all]| [r + right, a + all]);
        right as f64 / all as f64
    }

    #[track_caller]
    fn assert(&self, what: &str, least_of_stairs: f64) {
        for (kind, [right, all]) in &self.kinds {
            println!("{what}: {kind:?} {right} of {all}, {:.2} %", 100.0 * *right as f64 / *all as f64);
        }
        let (all, ground) = (self.of(|_| true), self.of(Kind::is_ground));
        println!("{what}: all {:.2} %, ground {:.2} %", 100.0 * all, 100.0 * ground);
        assert!(all >= 0.98 && ground >= 0.98, "{what}: {all:.4} of all, {ground:.4} of the ground");
        let stairs = self.flight[0] as f64 / self.flight[1] as f64;
        println!("{what}: of the flight of stairs {:.2} % stay", 100.0 * stairs);
        assert!(stairs >= least_of_stairs, "{what}: {stairs:.4} of the stairs stay");
    }
}

#[test]
fn of_a_whole_cloud_at_least_98_percent_are_labelled_right() {
    for (seed, ramp_deg) in [(1, 4.8), (2, 7.1), (3, 4.8)] {
        let (scene, mut random) = (Scene::station(ramp_deg), Random(seed));
        let rise = 6.0 * ramp_deg.to_radians().tan();
        let mut points = Vec::new();
        for from in path(rise) {
            for yaw in 0..12 {
                for pitch in [-35.0, -10.0, 20.0] {
                    points.extend(scene.scan(from, 30.0 * f64::from(yaw), pitch, 1500, &mut random));
                }
            }
        }
        let labels: std::collections::HashMap<[u32; 3], Kind> =
            points.iter().map(|(point, kind)| (point.map(f32::to_bits), *kind)).collect();
        let cloud: Vec<[f32; 3]> = points.iter().map(|(point, _)| *point).collect();
        let filter = CloudFilter::new(CloudFilterConfig {
            outliers: None,
            bounds: BoundsConfig::default(),
            ground: Some(GroundConfig::default()),
            reach_m: 1e4,
        });
        let mut score = Score::default();
        let visit = |point: [f32; 3], verdict| {
            score.add(point, labels[&point.map(f32::to_bits)], verdict == Verdict::Ground);
        };
        filter.unwrap().run(&mut cloud.as_slice(), visit).unwrap();
        score
            .assert(&format!("cloud, seed {seed}, ramp of {ramp_deg} degrees, {} points", cloud.len()), 0.98);
    }
}

#[test]
fn of_the_scans_of_a_walk_at_least_98_percent_are_labelled_right() {
    for (seed, ramp_deg) in [(4, 4.8), (5, 7.1)] {
        let (scene, mut random) = (Scene::station(ramp_deg), Random(seed));
        let rise = 6.0 * ramp_deg.to_radians().tan();
        let mut filter = GroundFilter::new(GroundConfig::default(), 30_000);
        let mut score = Score::default();
        for from in path(rise) {
            // The sensor looks a little down as it is carried, and all around.
            for yaw in 0..12 {
                let scan = scene.scan(from, 30.0 * f64::from(yaw), -8.0, 10_000, &mut random);
                let points: Vec<[f32; 3]> = scan.iter().map(|(point, _)| *point).collect();
                let ground = filter.ground_of_scan(&points, from);
                scan.iter().zip(ground).for_each(|((point, kind), ground)| score.add(*point, *kind, *ground));
            }
        }
        // One scan may show treads from above without their risers.
        score.assert(&format!("scans, seed {seed}, ramp of {ramp_deg} degrees"), 0.95);
    }
}
