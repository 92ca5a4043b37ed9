//! Solids: a shape of some material, smooth or rough, and the parts of people.

use evac_geometry::nalgebra::Vector3;
use evac_geometry::rotation_from_euler;

use super::material::Material;
use super::ray::{Bounds, Ray};
use super::relief::Relief;
use super::shape::Shape;

/// A body that stands in the building.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Solid {
    shape: Shape,
    pub(crate) material: Material,
    relief: Option<Relief>,
}

impl Solid {
    fn new(shape: Shape, material: Material) -> Self {
        Self { shape, material, relief: None }
    }

    /// A box by two opposite corners.
    pub(crate) fn between(min: [f64; 3], max: [f64; 3], material: Material) -> Self {
        let (min, max) = (Vector3::from(min), Vector3::from(max));
        let (centre, half) = ((min + max) / 2.0, (max - min) / 2.0);
        Self::new(Shape::Block { centre, half, sin: 0.0, cos: 1.0 }, material)
    }

    /// A box by its centre and whole size, turned counterclockwise.
    pub(crate) fn turned(centre: [f64; 3], size: [f64; 3], degrees: f64, material: Material) -> Self {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let half = Vector3::from(size) / 2.0;
        Self::new(Shape::Block { centre: centre.into(), half, sin, cos }, material)
    }

    /// A box by its centre and whole size, turned by roll, pitch and yaw in degrees (R = Rz Ry Rx).
    pub(super) fn tilted(centre: [f64; 3], size: [f64; 3], degrees: [f64; 3], material: Material) -> Self {
        let [roll, pitch, yaw] = degrees.map(f64::to_radians);
        let world_from_box = *rotation_from_euler(roll, pitch, yaw).matrix();
        let half = Vector3::from(size) / 2.0;
        Self::new(Shape::Tilted { centre: centre.into(), half, world_from_box }, material)
    }

    /// A cylinder between the middles of its lids, which must be apart.
    pub(super) fn pipe(from: [f64; 3], to: [f64; 3], radius: f64, material: Material) -> Self {
        let (from, to) = (Vector3::from(from), Vector3::from(to));
        let length = (to - from).norm();
        let shape = Shape::Pipe {
            centre: (from + to) / 2.0,
            axis: (to - from) / length,
            half_length: length / 2.0,
            radius,
        };
        Self::new(shape, material)
    }

    pub(super) fn ball(centre: [f64; 3], radius: f64, material: Material) -> Self {
        Self::new(Shape::Ball { centre: centre.into(), radius }, material)
    }

    /// A disc by its centre, normal (a unit vector) and radius.
    pub(super) fn disc(centre: Vector3<f64>, normal: Vector3<f64>, radius: f64, material: Material) -> Self {
        Self::new(Shape::Disc { centre, normal, radius }, material)
    }

    /// The same body with a surface that is no ideal plane: `rms` metres off it where the material is as rough as
    /// materials get, less on others.
    pub(super) fn roughened(self, rms: f64, seed: u64) -> Self {
        Self { relief: Relief::new(rms * self.material.roughness(), seed), ..self }
    }

    /// The smallest axis-aligned box around it.
    pub(crate) fn bounds(&self) -> Bounds {
        let bounds = self.shape.bounds();
        let Some(relief) = &self.relief else { return bounds };
        let reach = Vector3::repeat(relief.bound());
        Bounds { min: bounds.min - reach, max: bounds.max + reach }
    }

    /// Distance along the ray to where it enters the body; `None` where it misses, starts inside or is farther than
    /// `limit`.
    #[inline]
    pub(super) fn hit(&self, ray: &Ray, limit: f64) -> Option<f64> {
        let Some(relief) = &self.relief else {
            return self
                .shape
                .interval(ray, 0.0)
                .and_then(|(enter, _)| (enter > 0.0 && enter < limit).then_some(enter));
        };
        let (enter, leave) = self.shape.interval(ray, relief.bound())?;
        if enter >= limit {
            return None;
        }
        let at = |t: f64| ray.origin + ray.direction * t;
        let range = relief.march(enter.max(0.0), leave.min(limit), at, |place| self.shape.distance(place))?;
        (range > 0.0 && range < limit).then_some(range)
    }

    /// Distance of a point from the smooth body, 0 inside, metres.
    pub(crate) fn distance(&self, point: &Vector3<f64>) -> f64 {
        self.shape.distance(point).max(0.0)
    }
}

/// An upright cylinder: a part of a person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cylinder {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) radius: f64,
    pub(crate) bottom: f64,
    pub(crate) top: f64,
}

impl Cylinder {
    /// Distance along the ray to the mantle or the lid; `None` where it misses or starts inside.
    pub(super) fn hit(&self, ray: &Ray) -> Option<f64> {
        let (ox, oy) = (ray.origin.x - self.x, ray.origin.y - self.y);
        let a = ray.direction.x * ray.direction.x + ray.direction.y * ray.direction.y;
        let half_b = ox * ray.direction.x + oy * ray.direction.y;
        let discriminant = half_b * half_b - a * (ox * ox + oy * oy - self.radius * self.radius);
        if discriminant < 0.0 || a == 0.0 {
            return None;
        }
        let root = discriminant.sqrt();
        let (z0, z1) = (self.bottom - ray.origin.z, self.top - ray.origin.z);
        let (low, high) = (z0 * ray.inverse.z, z1 * ray.inverse.z);
        let enter = ((-half_b - root) / a).max(low.min(high));
        let leave = ((-half_b + root) / a).min(low.max(high));
        (enter > 0.0 && enter <= leave).then_some(enter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_the_near_face_of_a_box_and_of_a_turned_box() {
        let ray = Ray::new(Vector3::zeros(), Vector3::x());
        let straight = Solid::between([2.0, -1.0, -1.0], [4.0, 1.0, 1.0], Material::Metal);
        assert_eq!(straight.hit(&ray, f64::INFINITY), Some(2.0));
        let turned = Solid::turned([3.0, 0.0, 0.0], [2.0, 2.0, 2.0], 45.0, Material::Metal);
        assert!((turned.hit(&ray, f64::INFINITY).unwrap() - (3.0 - 2.0_f64.sqrt())).abs() < 1e-12);
        assert_eq!(straight.hit(&Ray::new(Vector3::zeros(), -Vector3::x()), 9.0), None);
        assert_eq!(straight.hit(&Ray::new(Vector3::new(3.0, 0.0, 0.0), Vector3::x()), 9.0), None);
    }

    #[test]
    fn a_ray_meets_the_mantle_of_a_cylinder_and_its_lid_from_above() {
        let person = Cylinder { x: 3.0, y: 0.0, radius: 0.25, bottom: 0.0, top: 1.7 };
        let level = Ray::new(Vector3::new(0.0, 0.0, 1.0), Vector3::x());
        assert!((person.hit(&level).unwrap() - 2.75).abs() < 1e-12);
        let down = Ray::new(Vector3::new(3.0, 0.1, 3.7), Vector3::new(0.001, 0.0, -1.0).normalize());
        assert!((person.hit(&down).unwrap() - 2.0).abs() < 1e-4);
        let above = Ray::new(Vector3::new(0.0, 0.0, 2.0), Vector3::x());
        assert_eq!(person.hit(&above), None);
    }

    #[test]
    fn a_rough_wall_is_off_its_plane_by_the_configured_rms_for_every_angle_of_incidence() {
        let wall = Solid::between([-5.0, 2.0, -5.0], [5.0, 2.3, 5.0], Material::Plaster);
        let rough = wall.roughened(0.02, 7);
        for slant in [0.0, 1.0, 3.0] {
            let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
            for k in 0..10_000 {
                let aim = Vector3::new(f64::from(k % 100) * 0.09 - 4.5, 2.0, f64::from(k / 100) * 0.09 - 4.5);
                let ray =
                    Ray::new(aim - Vector3::new(slant, 1.0, 0.0), Vector3::new(slant, 1.0, 0.0).normalize());
                let Some(range) = rough.hit(&ray, 90.0) else { continue };
                let off = (ray.origin + ray.direction * range).y - 2.0;
                sum += off;
                squares += off * off;
                count += 1.0;
            }
            let rms: f64 = f64::sqrt(squares / count);
            assert!(
                count > 9900.0 && (rms / 0.02 - 1.0).abs() < 0.15,
                "slant {slant}: rms {rms} m of {count}"
            );
            // A slanting ray rather meets what stands out.
            let mean: f64 = sum / count;
            assert!(mean.abs() < 0.003 + 0.003 * slant, "slant {slant}: mean {mean} m");
        }
        assert_eq!(wall.roughened(0.0, 7).hit(&Ray::new(Vector3::zeros(), Vector3::y()), 90.0), Some(2.0));
    }
}
