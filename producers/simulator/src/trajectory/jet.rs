//! A value with its first and second derivative in time: composing these keeps pose, velocity and acceleration of the
//! walk consistent to rounding.

use std::ops::{Add, Mul};

/// Value, first and second time derivative.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Jet {
    pub(super) x: f64,
    pub(super) v: f64,
    pub(super) a: f64,
}

impl Jet {
    pub(super) const fn constant(x: f64) -> Self {
        Self { x, v: 0.0, a: 0.0 }
    }

    /// `f(self)` by the chain rule, given `f`, `f'` and `f''` at `self.x`.
    pub(super) fn through(self, [f, f1, f2]: [f64; 3]) -> Self {
        Self { x: f, v: f1 * self.v, a: f2 * self.v * self.v + f1 * self.a }
    }

    pub(super) fn sin(self) -> Self {
        let (sin, cos) = self.x.sin_cos();
        self.through([sin, cos, -sin])
    }

    pub(super) fn cos(self) -> Self {
        let (sin, cos) = self.x.sin_cos();
        self.through([cos, -sin, -cos])
    }
}

impl Add for Jet {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, v: self.v + other.v, a: self.a + other.a }
    }
}

impl Mul for Jet {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self {
            x: self.x * other.x,
            v: self.v * other.x + self.x * other.v,
            a: self.a * other.x + 2.0 * self.v * other.v + self.x * other.a,
        }
    }
}

impl Mul<f64> for Jet {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self { x: self.x * factor, v: self.v * factor, a: self.a * factor }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_a_product_of_sine_and_cosine_are_those_of_half_the_sine_of_the_double_angle() {
        let t = Jet { x: 0.7, v: 1.0, a: 0.0 };
        let product = t.sin() * t.cos();
        assert!((product.x - 0.5 * 1.4_f64.sin()).abs() < 1e-15);
        assert!((product.v - 1.4_f64.cos()).abs() < 1e-15);
        assert!((product.a + 2.0 * 1.4_f64.sin()).abs() < 1e-15);
    }
}
