//! OctoMap's insertion as its paper tells it: sets of keys and a map from key to value. Slow and plain.

use std::collections::{BTreeMap, BTreeSet};

use evac_octree::{Key, SensorModel};

#[derive(Default)]
pub(crate) struct NaiveMap {
    pub(crate) voxels: BTreeMap<Key, f32>,
    pub(crate) ground: BTreeSet<Key>,
}

pub(crate) struct NaiveScan<'a> {
    pub(crate) origin: [f32; 3],
    pub(crate) hits: &'a [[f32; 3]],
    pub(crate) ground: &'a [[f32; 3]],
    pub(crate) misses: &'a [[f32; 3]],
    pub(crate) max_range: Option<f64>,
    pub(crate) discretize: bool,
}

impl NaiveMap {
    pub(crate) fn insert(&mut self, resolution: f64, sensor: &SensorModel, scan: &NaiveScan<'_>) {
        let (mut free, mut occupied) = (BTreeSet::new(), BTreeSet::new());
        for (points, kind) in [(scan.hits, 'h'), (scan.ground, 'g'), (scan.misses, 'm')] {
            for &point in points {
                let point = match key(point, resolution) {
                    Some(k) if scan.discretize && kind != 'm' => {
                        k.map(|axis| ((f64::from(axis) - 32768.0 + 0.5) * resolution) as f32)
                    }
                    None if scan.discretize && kind != 'm' => continue,
                    _ => point,
                };
                let (unit, length) = unit(scan.origin, point);
                let cut = scan.max_range.filter(|&range| length > range);
                let end = match cut {
                    Some(range) => std::array::from_fn(|i| scan.origin[i] + unit[i] * range as f32),
                    None => point,
                };
                let Some(passed) = ray(scan.origin, end, resolution) else { continue };
                free.extend(passed);
                let last = key(end, resolution).filter(|_| cut.is_none() && kind != 'm');
                if let Some(last) = last {
                    if kind == 'h' {
                        occupied.insert(last);
                    } else {
                        free.insert(last);
                        self.ground.insert(last);
                    }
                }
            }
        }
        for key in free.difference(&occupied) {
            self.add(*key, sensor.miss, sensor);
        }
        for key in &occupied {
            self.add(*key, sensor.hit, sensor);
        }
    }

    fn add(&mut self, key: Key, update: f32, sensor: &SensorModel) {
        let value = self.voxels.entry(key).or_insert(0.0);
        *value = (*value + update).max(sensor.clamp_min).min(sensor.clamp_max);
    }
}

fn key(point: [f32; 3], resolution: f64) -> Option<Key> {
    let mut key = [0; 3];
    for axis in 0..3 {
        let index = ((1.0 / resolution) * f64::from(point[axis])).floor() as i64 + 32768;
        key[axis] = u16::try_from(index).ok()?;
    }
    Some(key)
}

fn unit(from: [f32; 3], to: [f32; 3]) -> ([f32; 3], f64) {
    let d: [f32; 3] = std::array::from_fn(|i| to[i] - from[i]);
    let length = f64::from(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    (d.map(|c| c / length as f32), length)
}

fn ray(origin: [f32; 3], end: [f32; 3], resolution: f64) -> Option<Vec<Key>> {
    let (mut at, last) = (key(origin, resolution)?, key(end, resolution)?);
    if at == last {
        return Some(Vec::new());
    }
    let (direction, length) = unit(origin, end);
    let mut passed = vec![at];
    let mut next = [f64::MAX; 3];
    let mut every = [f64::MAX; 3];
    for i in 0..3 {
        if direction[i] != 0.0 {
            let half = f64::from((f64::from(direction[i].signum()) * resolution * 0.5) as f32);
            let border = (f64::from(at[i]) - 32768.0 + 0.5) * resolution + half;
            next[i] = (border - f64::from(origin[i])) / f64::from(direction[i]);
            every[i] = resolution / f64::from(direction[i].abs());
        }
    }
    loop {
        // The last axis among equals.
        let axis = (0..3).fold(0, |first, axis| if next[axis] <= next[first] { axis } else { first });
        at[axis] = if direction[axis] > 0.0 { at[axis] + 1 } else { at[axis] - 1 };
        next[axis] += every[axis];
        if at == last || next.iter().all(|&t| t > f64::from(length as f32)) {
            return Some(passed);
        }
        passed.push(at);
    }
}
