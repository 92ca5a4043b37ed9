//! The points nearest to a place, by sorted cells.

use evac_geometry::nalgebra::Vector3;

/// Edge of a cell, metres. Neighbours farther than that are not looked for.
const CELL: f64 = 0.3;

type Key = [i32; 3];

/// Points in cells, in the order of the cells.
#[derive(Debug)]
pub(super) struct Neighbours {
    cells: Vec<(Key, Vector3<f64>)>,
}

impl Neighbours {
    pub(super) fn new(points: &[Vector3<f64>]) -> Self {
        let mut cells: Vec<(Key, Vector3<f64>)> = points.iter().map(|point| (key(point), *point)).collect();
        cells.sort_by_key(|(key, _)| *key);
        Self { cells }
    }

    /// The `count` points nearest to a place, nearest first, with their squared distances, into `near`; fewer where the
    /// cells around hold fewer.
    pub(super) fn nearest(&self, place: &Vector3<f64>, count: usize, near: &mut Vec<(f64, Vector3<f64>)>) {
        near.clear();
        let [x, y, z] = key(place);
        for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
            // Three cells above each other are one stretch.
            let [low, high] = [[x + dx, y + dy, z - 1], [x + dx, y + dy, z + 1]];
            let first = self.cells.partition_point(|(key, _)| *key < low);
            let stretch = self.cells.iter().skip(first).take_while(|(key, _)| *key <= high);
            near.extend(stretch.map(|(_, point)| ((point - place).norm_squared(), *point)));
        }
        near.retain(|(square, _)| *square <= CELL * CELL);
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(count);
    }
}

fn key(point: &Vector3<f64>) -> Key {
    <[f64; 3]>::from(point / CELL).map(|x| x.floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_nearest_by_cells_are_the_nearest_of_all() {
        let mut random = Random::new(3, 0);
        let points: Vec<Vector3<f64>> =
            (0..2000).map(|_| Vector3::from([0; 3].map(|_| random.within(-1.0, 1.0)))).collect();
        let neighbours = Neighbours::new(&points);
        let mut near = Vec::new();
        for place in points.iter().step_by(50) {
            neighbours.nearest(place, 8, &mut near);
            let mut all: Vec<f64> = points.iter().map(|point| (point - place).norm_squared()).collect();
            all.sort_by(f64::total_cmp);
            all.retain(|square| *square <= CELL * CELL);
            all.truncate(8);
            assert_eq!(near.iter().map(|(square, _)| *square).collect::<Vec<_>>(), all);
        }
    }
}
