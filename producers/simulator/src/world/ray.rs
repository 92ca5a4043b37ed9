//! Rays, and the axis-aligned boxes that they are tested against.

use evac_geometry::nalgebra::Vector3;

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
