//! Walking people: two cylinders each, their place a function of time.

use super::solid::Cylinder;

/// Somebody who walks round a closed path at constant speed.
#[derive(Debug, Clone)]
pub(crate) struct Person {
    path: Vec<[f64; 2]>,
    speed: f64,
    start: f64,
}

impl Person {
    /// Walks the closed path at `speed` (m/s), being `start` metres along it at time 0.
    pub(super) fn new(path: &[[f64; 2]], speed: f64, start: f64) -> Self {
        Self { path: path.to_vec(), speed, start }
    }

    /// Place on the floor at `t` seconds.
    pub(crate) fn at(&self, t: f64) -> [f64; 2] {
        let legs = || self.path.iter().zip(self.path.iter().cycle().skip(1));
        let length = |a: &[f64; 2], b: &[f64; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
        let whole: f64 = legs().map(|(a, b)| length(a, b)).sum();
        let mut left = (self.start + self.speed * t).rem_euclid(whole);
        for (a, b) in legs() {
            let leg = length(a, b);
            if left <= leg {
                let share = left / leg;
                return [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share];
            }
            left -= leg;
        }
        self.path.first().copied().unwrap_or_default()
    }

    /// Body and head at `t` seconds.
    pub(super) fn shape(&self, t: f64) -> [Cylinder; 2] {
        let [x, y] = self.at(t);
        [
            Cylinder { x, y, radius: 0.23, bottom: 0.0, top: 1.48 },
            Cylinder { x, y, radius: 0.11, bottom: 1.48, top: 1.76 },
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_person_goes_round_the_path_and_comes_back_to_its_start() {
        let person = Person::new(&[[0.0, 0.0], [4.0, 0.0], [4.0, 2.0]], 1.0, 1.0);
        assert_eq!(person.at(0.0), [1.0, 0.0]);
        assert_eq!(person.at(4.0), [4.0, 1.0]);
        let round = 4.0 + 2.0 + 20.0_f64.sqrt();
        let back = person.at(round);
        assert!((back[0] - 1.0).abs() < 1e-9 && back[1].abs() < 1e-9);
    }
}
