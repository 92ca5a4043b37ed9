//! Shapes and where a ray meets them.

use evac_geometry::nalgebra::{Matrix3, Vector3};

use super::ray::{Bounds, Ray};

/// A body without material.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    /// A box turned about the vertical.
    Block {
        centre: Vector3<f64>,
        half: Vector3<f64>,
        sin: f64,
        cos: f64,
    },
    /// A box turned anyhow.
    Tilted {
        centre: Vector3<f64>,
        half: Vector3<f64>,
        world_from_box: Matrix3<f64>,
    },
    /// A cylinder along any axis (a unit vector).
    Pipe {
        centre: Vector3<f64>,
        axis: Vector3<f64>,
        half_length: f64,
        radius: f64,
    },
    Ball {
        centre: Vector3<f64>,
        radius: f64,
    },
    /// A disc without thickness, by its normal (a unit vector); it is met from both sides.
    Disc {
        centre: Vector3<f64>,
        normal: Vector3<f64>,
        radius: f64,
    },
}

impl Shape {
    /// The smallest axis-aligned box around it (for a pipe: around its ends' spheres' discs).
    pub(super) fn bounds(&self) -> Bounds {
        let (centre, reach) = match self {
            Self::Block { centre, half, sin, cos } => {
                let (sin, cos) = (sin.abs(), cos.abs());
                (centre, Vector3::new(cos * half.x + sin * half.y, sin * half.x + cos * half.y, half.z))
            }
            Self::Tilted { centre, half, world_from_box } => (centre, world_from_box.abs() * half),
            Self::Pipe { centre, axis, half_length, radius } => {
                let across = axis.map(|a| (1.0 - a * a).max(0.0).sqrt());
                (centre, axis.abs() * *half_length + across * *radius)
            }
            Self::Ball { centre, radius } => (centre, Vector3::repeat(*radius)),
            Self::Disc { centre, normal, radius } => {
                (centre, normal.map(|n| (1.0 - n * n).max(0.0).sqrt()) * *radius)
            }
        };
        Bounds { min: centre - reach, max: centre + reach }
    }

    /// Where the ray comes in and goes out again, of the shape grown by `grown` metres; the entry is behind the origin
    /// where the ray starts inside.
    #[inline]
    pub(super) fn interval(&self, ray: &Ray, grown: f64) -> Option<(f64, f64)> {
        match self {
            Self::Block { centre, half, sin, cos } => {
                let half = half.add_scalar(grown);
                if *sin == 0.0 {
                    return Bounds { min: centre - half, max: centre + half }.interval(ray);
                }
                let turned =
                    |v: Vector3<f64>| Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
                let local = Ray::new(turned(ray.origin - centre), turned(ray.direction));
                Bounds { min: -half, max: half }.interval(&local)
            }
            Self::Tilted { centre, half, world_from_box } => {
                let half = half.add_scalar(grown);
                let local = Ray::new(
                    world_from_box.tr_mul(&(ray.origin - centre)),
                    world_from_box.tr_mul(&ray.direction),
                );
                Bounds { min: -half, max: half }.interval(&local)
            }
            Self::Pipe { centre, axis, half_length, radius } => {
                pipe(ray, centre, axis, half_length + grown, radius + grown)
            }
            Self::Ball { centre, radius } => {
                let from = ray.origin - centre;
                let half_b = from.dot(&ray.direction);
                let discriminant = half_b * half_b - (from.norm_squared() - (radius + grown).powi(2));
                let root = (discriminant >= 0.0).then(|| discriminant.sqrt())?;
                (root >= half_b).then_some((-half_b - root, root - half_b))
            }
            Self::Disc { centre, normal, radius } => {
                let range = normal.dot(&(centre - ray.origin)) / normal.dot(&ray.direction);
                let off = ray.origin + ray.direction * range - centre;
                (range >= 0.0 && off.norm_squared() <= radius * radius).then_some((range, range))
            }
        }
    }

    /// Distance of a place from the surface, metres; negative inside.
    pub(super) fn distance(&self, place: &Vector3<f64>) -> f64 {
        match self {
            Self::Block { centre, half, sin, cos } => {
                let v = place - centre;
                let local = Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
                from_box(&local, half)
            }
            Self::Tilted { centre, half, world_from_box } => {
                from_box(&world_from_box.tr_mul(&(place - centre)), half)
            }
            Self::Pipe { centre, axis, half_length, radius } => {
                let v = place - centre;
                let along = v.dot(axis);
                let out = (v - axis * along).norm() - radius;
                let beyond = along.abs() - half_length;
                out.max(0.0).hypot(beyond.max(0.0)) + out.max(beyond).min(0.0)
            }
            Self::Ball { centre, radius } => (place - centre).norm() - radius,
            Self::Disc { centre, normal, radius } => {
                let v = place - centre;
                let above = v.dot(normal);
                ((v - normal * above).norm() - radius).max(0.0).hypot(above)
            }
        }
    }
}

fn from_box(local: &Vector3<f64>, half: &Vector3<f64>) -> f64 {
    let beyond = local.abs() - half;
    beyond.sup(&Vector3::zeros()).norm() + beyond.max().min(0.0)
}

fn pipe(
    ray: &Ray,
    centre: &Vector3<f64>,
    axis: &Vector3<f64>,
    half_length: f64,
    radius: f64,
) -> Option<(f64, f64)> {
    let from = ray.origin - centre;
    let (along, slope) = (from.dot(axis), ray.direction.dot(axis));
    let (out, spread) = (from - axis * along, ray.direction - axis * slope);
    // Between the planes of the lids; a ray that runs along them is between them always or never.
    let (a, b) = ((-half_length - along) / slope, (half_length - along) / slope);
    let (mut enter, mut leave) = (a.min(b), a.max(b));
    if slope.abs() < 1e-12 {
        if along.abs() > half_length {
            return None;
        }
        (enter, leave) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    let square = spread.norm_squared();
    let rest = out.norm_squared() - radius * radius;
    if square < 1e-18 {
        return (rest <= 0.0 && leave >= 0.0).then_some((enter, leave));
    }
    let half_b = out.dot(&spread);
    let discriminant = half_b * half_b - square * rest;
    if discriminant < 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    let (enter, leave) = (enter.max((-half_b - root) / square), leave.min((-half_b + root) / square));
    (enter <= leave && leave >= 0.0).then_some((enter, leave))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn shapes() -> [Shape; 5] {
        let centre = Vector3::new(0.3, -0.2, 0.1);
        let half = Vector3::new(0.8, 0.5, 0.3);
        let rotation = evac_geometry::rotation_from_euler(0.3, -0.5, 1.1);
        [
            Shape::Block { centre, half, sin: 0.0, cos: 1.0 },
            Shape::Block { centre, half, sin: 0.6, cos: 0.8 },
            Shape::Tilted { centre, half, world_from_box: *rotation.matrix() },
            Shape::Pipe { centre, axis: Vector3::new(0.6, 0.0, 0.8), half_length: 0.9, radius: 0.4 },
            Shape::Ball { centre, radius: 0.7 },
        ]
    }

    #[test]
    fn rays_enter_and_leave_where_the_distance_is_zero_and_are_inside_between() {
        let mut random = Random::new(4, 0);
        for shape in shapes() {
            let mut hits = 0;
            for _ in 0..500 {
                let origin = Vector3::from(random.normals()).normalize() * 3.0;
                let aim = Vector3::from(random.normals()) * 0.4;
                let ray = Ray::new(origin, (aim - origin).normalize());
                let Some((enter, leave)) = shape.interval(&ray, 0.0) else { continue };
                hits += 1;
                let at = |t: f64| ray.origin + ray.direction * t;
                assert!(shape.distance(&at(enter)).abs() < 1e-9, "{shape:?}");
                assert!(shape.distance(&at(leave)).abs() < 1e-9, "{shape:?}");
                assert!(shape.distance(&at((enter + leave) / 2.0)) <= 1e-9, "{shape:?}");
                let bounds = shape.bounds();
                assert!((0..3).all(|i| at(enter)[i] > bounds.min[i] - 1e-9));
                assert!((0..3).all(|i| at(enter)[i] < bounds.max[i] + 1e-9));
            }
            assert!(hits > 100, "{hits} hits on {shape:?}");
        }
    }
}
