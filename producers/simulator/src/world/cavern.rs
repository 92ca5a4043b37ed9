//! Rooms cut out of the rock: the union of hollows, seen from inside.

use evac_geometry::nalgebra::Vector3;

use super::ray::Ray;
use super::relief::Relief;
use super::shape::Shape;

/// Two ends of hollows nearer than this along a ray are the same place, metres.
const SAME: f64 = 1e-6;

/// Convex hollows that run into each other. Their surface is that of all of them together.
#[derive(Debug, Clone)]
pub(super) struct Cavern {
    hollows: Vec<Shape>,
    relief: Option<Relief>,
}

impl Cavern {
    /// The union of the hollows, with walls `rms` metres off their shapes; `None` where nothing is hollow.
    pub(super) fn new(hollows: Vec<Shape>, rms: f64, seed: u64) -> Option<Self> {
        (!hollows.is_empty()).then(|| Self { hollows, relief: Relief::new(rms, seed) })
    }

    /// Distance of a place from the smooth wall, metres; negative in the rock.
    pub(super) fn depth(&self, place: &Vector3<f64>) -> f64 {
        -self.hollows.iter().map(|hollow| hollow.distance(place)).fold(f64::INFINITY, f64::min)
    }

    /// Distance along the ray to the wall; `None` where it is farther than `limit` or the ray starts in the rock.
    pub(super) fn cast(&self, ray: &Ray, limit: f64) -> Option<f64> {
        let bound = self.relief.map_or(0.0, |relief| relief.bound());
        // Where the ray leaves the part that no height reaches into.
        let mut way = 0.0;
        while way < limit {
            let leaves = |hollow: &Shape| {
                let (enter, leave) = hollow.interval(ray, -bound)?;
                (enter <= way + SAME && leave > way + SAME).then_some(leave)
            };
            match self.hollows.iter().filter_map(leaves).reduce(f64::max) {
                Some(leave) => way = leave,
                None => break,
            }
        }
        if way == 0.0 || way >= limit {
            return None;
        }
        let Some(relief) = &self.relief else { return Some(way) };
        relief.march(way, limit, |t| ray.origin + ray.direction * t, |place| self.depth(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crossing(rms: f64) -> Cavern {
        let bore = |axis: Vector3<f64>| Shape::Pipe {
            centre: Vector3::zeros(),
            axis,
            half_length: 10.0,
            radius: 1.5,
        };
        Cavern::new(vec![bore(Vector3::x()), bore(Vector3::y())], rms, 1).unwrap()
    }

    #[test]
    fn a_ray_meets_the_wall_of_its_bore_and_runs_on_where_another_bore_crosses() {
        let cavern = crossing(0.0);
        let across = Ray::new(Vector3::new(5.0, 0.0, 0.0), Vector3::y());
        assert!((cavern.cast(&across, 90.0).unwrap() - 1.5).abs() < 1e-9);
        let through = Ray::new(Vector3::zeros(), Vector3::y());
        assert!((cavern.cast(&through, 90.0).unwrap() - 10.0).abs() < 1e-9);
        assert_eq!(cavern.cast(&through, 5.0), None);
        assert_eq!(cavern.cast(&Ray::new(Vector3::new(5.0, 5.0, 0.0), Vector3::x()), 90.0), None);
    }

    #[test]
    fn rough_walls_are_where_the_smooth_ones_are_in_the_mean() {
        let cavern = crossing(0.02);
        let (mut sum, mut squares) = (0.0, 0.0);
        for k in 0..4000 {
            let origin = Vector3::new(2.0 + f64::from(k % 80) * 0.09, 0.0, 0.0);
            let (sin, cos) = (f64::from(k) * 0.0157).sin_cos();
            let off = cavern.cast(&Ray::new(origin, Vector3::new(0.0, cos, sin)), 90.0).unwrap() - 1.5;
            sum += off;
            squares += off * off;
        }
        assert!((sum / 4000.0).abs() < 0.005, "mean {} m", sum / 4000.0);
        let rms = (squares / 4000.0_f64).sqrt();
        assert!((rms - 0.02).abs() < 0.004, "rms {rms} m");
    }
}
