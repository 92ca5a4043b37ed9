//! The same figures as evo (`golden/make.py` says how they were made).
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use evac_evaluation::{Evaluation, Pairs, Statistics, associate, associate_absolute};
use evac_formats::tum;
use serde_json::Value;

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

fn walk() -> Pairs {
    associate(&tum::read(&golden("truth.tum")).unwrap(), &tum::read(&golden("estimate.tum")).unwrap())
        .unwrap()
}

#[track_caller]
fn assert_same(name: &str, ours: &Statistics, evo: &Value) {
    for (figure, ours) in [
        ("rmse", ours.rmse),
        ("mean", ours.mean),
        ("median", ours.median),
        ("std", ours.std),
        ("max", ours.max),
    ] {
        let evo = evo[figure].as_f64().unwrap();
        assert!((ours - evo).abs() < 1e-9, "{name} {figure}: {ours}, evo says {evo}");
    }
}

#[test]
fn absolute_and_relative_errors_of_a_noisy_walk_are_those_that_evo_computes() {
    let evo: Value = serde_json::from_slice(&std::fs::read(golden("evo.json")).unwrap()).unwrap();
    let ours = Evaluation::of(&walk()).unwrap();
    assert_same("APE, SE(3)", &ours.ape_se3, &evo["ape_se3"]);
    assert_same("APE, first pose", &ours.ape_first, &evo["ape_first"]);
    assert_same("rotation, SE(3)", &ours.rotation_se3_deg, &evo["rotation_se3_deg"]);
    assert_same("rotation, first pose", &ours.rotation_first_deg, &evo["rotation_first_deg"]);
    for (name, ours) in [("rpe_1s", ours.rpe_1s.unwrap()), ("rpe_1m", ours.rpe_1m.unwrap())] {
        let (translation, rotation) =
            (&evo[format!("{name}_translation_m")], &evo[format!("{name}_rotation_deg")]);
        assert_eq!(ours.pairs as u64, translation["pairs"].as_u64().unwrap(), "{name}");
        assert_same(name, &ours.translation_m, translation);
        assert_same(name, &ours.rotation_deg, rotation);
    }
}

#[test]
fn one_clock_gives_the_same_pairs_by_absolute_times() {
    let (truth, estimate) =
        (tum::read(&golden("truth.tum")).unwrap(), tum::read(&golden("estimate.tum")).unwrap());
    assert_eq!(associate_absolute(&truth, &estimate).unwrap(), walk());
}
