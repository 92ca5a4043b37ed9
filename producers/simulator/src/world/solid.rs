//! Solids and where a ray meets them.

use evac_geometry::nalgebra::Vector3;

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Material {
    Concrete,
    Plaster,
    Metal,
    Wood,
    Glass,
    Sign,
    Cloth,
}

impl Material {
    /// Reflectivity as the Mid-40 reports it: 0..150 is 0..100 % diffuse, more is retro-reflective.
    pub(crate) fn reflectivity(self) -> f64 {
        match self {
            Self::Concrete => 40.0,
            Self::Plaster => 95.0,
            Self::Metal => 60.0,
            Self::Wood => 70.0,
            Self::Glass => 12.0,
            Self::Sign => 210.0,
            Self::Cloth => 30.0,
        }
    }

    /// Share of shots that come back.
    pub(crate) fn returns(self) -> f64 {
        if self == Self::Glass { 0.15 } else { 1.0 }
    }
}

/// A ray with the inverse of its direction, which box tests divide by.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: Vector3<f64>,
    pub(crate) direction: Vector3<f64>,
    pub(super) inverse: Vector3<f64>,
}

impl Ray {
    /// A ray from `origin` along the unit vector `direction`.
    pub(crate) fn new(origin: Vector3<f64>, direction: Vector3<f64>) -> Self {
        Self { origin, direction, inverse: direction.map(|x| 1.0 / x) }
    }
}

/// An axis-aligned box, by its corners.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) min: Vector3<f64>,
    pub(crate) max: Vector3<f64>,
}

impl Bounds {
    /// Where the ray comes in and goes out again (behind the origin where negative); `None` where it passes by.
    #[inline]
    pub(super) fn interval(&self, ray: &Ray) -> Option<(f64, f64)> {
        // Slabs; a NaN from 0 * inf (origin exactly in a face of a slab it runs along) is ignored by min and max.
        let a = (self.min - ray.origin).component_mul(&ray.inverse);
        let b = (self.max - ray.origin).component_mul(&ray.inverse);
        let enter = a.x.min(b.x).max(a.y.min(b.y)).max(a.z.min(b.z));
        let leave = a.x.max(b.x).min(a.y.max(b.y)).min(a.z.max(b.z));
        (enter <= leave && leave >= 0.0).then_some((enter, leave))
    }

    pub(super) fn surface(&self) -> f64 {
        let size = self.max - self.min;
        2.0 * (size.x * size.y + size.y * size.z + size.z * size.x)
    }

    pub(super) fn union(&self, other: &Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }
}

/// A box turned about the vertical axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Solid {
    centre: Vector3<f64>,
    half: Vector3<f64>,
    sin: f64,
    cos: f64,
    pub(crate) material: Material,
}

impl Solid {
    /// A box by two opposite corners.
    pub(crate) fn between(min: [f64; 3], max: [f64; 3], material: Material) -> Self {
        let (min, max) = (Vector3::from(min), Vector3::from(max));
        Self { centre: (min + max) / 2.0, half: (max - min) / 2.0, sin: 0.0, cos: 1.0, material }
    }

    /// A box by its centre and whole size, turned counterclockwise.
    pub(crate) fn turned(centre: [f64; 3], size: [f64; 3], degrees: f64, material: Material) -> Self {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Self { centre: centre.into(), half: Vector3::from(size) / 2.0, sin, cos, material }
    }

    /// The smallest axis-aligned box around it.
    pub(crate) fn bounds(&self) -> Bounds {
        let (sin, cos) = (self.sin.abs(), self.cos.abs());
        let reach = Vector3::new(
            cos * self.half.x + sin * self.half.y,
            sin * self.half.x + cos * self.half.y,
            self.half.z,
        );
        Bounds { min: self.centre - reach, max: self.centre + reach }
    }

    /// Distance along the ray to where it enters the box; `None` where it misses or starts inside.
    #[inline]
    pub(super) fn hit(&self, ray: &Ray) -> Option<f64> {
        if self.sin == 0.0 {
            let bounds = Bounds { min: self.centre - self.half, max: self.centre + self.half };
            return bounds.interval(ray).and_then(|(enter, _)| (enter > 0.0).then_some(enter));
        }
        let turned = |v: Vector3<f64>| {
            Vector3::new(self.cos * v.x + self.sin * v.y, self.cos * v.y - self.sin * v.x, v.z)
        };
        let inside = Bounds { min: -self.half, max: self.half };
        let local = Ray::new(turned(ray.origin - self.centre), turned(ray.direction));
        inside.interval(&local).and_then(|(enter, _)| (enter > 0.0).then_some(enter))
    }

    /// Distance of a point from the box, 0 inside.
    #[cfg(test)]
    pub(crate) fn distance(&self, point: &Vector3<f64>) -> f64 {
        let v = point - self.centre;
        let local = Vector3::new(self.cos * v.x + self.sin * v.y, self.cos * v.y - self.sin * v.x, v.z).abs()
            - self.half;
        local.sup(&Vector3::zeros()).norm()
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
        assert_eq!(straight.hit(&ray), Some(2.0));
        let turned = Solid::turned([3.0, 0.0, 0.0], [2.0, 2.0, 2.0], 45.0, Material::Metal);
        assert!((turned.hit(&ray).unwrap() - (3.0 - 2.0_f64.sqrt())).abs() < 1e-12);
        assert_eq!(straight.hit(&Ray::new(Vector3::zeros(), -Vector3::x())), None);
        assert_eq!(straight.hit(&Ray::new(Vector3::new(3.0, 0.0, 0.0), Vector3::x())), None);
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
}
