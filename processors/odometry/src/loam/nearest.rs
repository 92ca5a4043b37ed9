//! The list of the nearest points.

use evac_geometry::nalgebra::Vector3;

/// Points of the map around a place that are matched with: as many as the paper's.
pub(crate) const NEIGHBOURS: usize = 5;

/// Takes a candidate into the list of the nearest. Of two that are closer together than the square root of `apart` only the
/// nearer stays: a surface on the border of two layers of voxels has a mean in either, and such pairs are no plane.
pub(crate) fn insert_sorted(
    nearest: &mut [(f64, Vector3<f64>); NEIGHBOURS],
    mut new: (f64, Vector3<f64>),
    apart: f64,
) {
    let mut twins = nearest.iter().enumerate().filter(|(_, kept)| (kept.1 - new.1).norm_squared() < apart);
    if let Some((index, twin)) = twins.find(|(_, kept)| kept.0.is_finite()) {
        if twin.0 <= new.0 {
            return;
        }
        // The twin's place is free: what is nearer than it moves on to there.
        nearest[index].0 = f64::INFINITY;
        nearest[index..].rotate_left(1);
    }
    for kept in nearest.iter_mut() {
        if new.0 < kept.0 {
            std::mem::swap(kept, &mut new);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_stay_in_order_and_a_twin_gives_way_to_a_nearer_one() {
        let mut nearest = [(f64::INFINITY, Vector3::zeros()); NEIGHBOURS];
        for x in [0.9, 0.1, 0.5, 1.3, 0.52, 1.7, 0.3, 0.28] {
            insert_sorted(&mut nearest, (x * x, Vector3::x() * x), 0.01);
        }
        assert_eq!(nearest.map(|(_, point)| point.x), [0.1, 0.28, 0.5, 0.9, 1.3]);
    }
}
