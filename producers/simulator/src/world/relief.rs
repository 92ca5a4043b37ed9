//! Surfaces that are no ideal planes: a height field over place, the same for every ray and every run.
//!
//! Two layers of value noise: undulation over about a metre and grain over some centimetres, as of plaster that was put on
//! by hand and of stone that was broken. Heights are a function of the place in space, so that neighbours agree, and a
//! surface seen again from elsewhere is the same surface.

use evac_geometry::nalgebra::Vector3;

/// Edges of the noise's cells, metres: undulation in two octaves, and grain.
const UNDULATION_CELLS: [f64; 2] = [0.9, 0.35];
const GRAIN_CELL: f64 = 0.06;
/// Shares of the whole rms; the sum of their squares is 1.
const UNDULATION_SHARES: [f64; 2] = [0.80, 0.40];
const GRAIN_SHARE: f64 = 0.447_213_6;
/// Root mean square of value noise whose corners are evenly distributed in [-1, 1] with the cubic smooth step between
/// them: the square of the step and of its complement sum to 26/35 in the mean, per axis; the corners' variance is 1/3.
const NOISE_RMS: f64 = 0.369_7;

/// Largest heights against the noise's scale: three times the rms of the whole and of the grain.
const BOUND: f64 = 3.0 * NOISE_RMS;
const GRAIN_BOUND: f64 = 3.0 * NOISE_RMS * GRAIN_SHARE;

/// A height field with its bound.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Relief {
    scale: f64,
    seed: u64,
}

impl Relief {
    /// A field with a root mean square of `rms` metres; `None` where there is nothing to speak of.
    pub(super) fn new(rms: f64, seed: u64) -> Option<Self> {
        (rms > 1e-5).then_some(Self { scale: rms / NOISE_RMS, seed: seed.wrapping_mul(3) })
    }

    /// No height is larger, metres: three times the rms. (The noise itself ends at five times, which it hardly ever
    /// reaches; a thinner shell around the surface is quicker to march through.)
    pub(super) fn bound(&self) -> f64 {
        self.scale * BOUND
    }

    /// Height of the surface at a place, metres; positive stands out.
    pub(super) fn height(&self, place: &Vector3<f64>) -> f64 {
        let place = askew(place);
        (self.undulation(&place) + self.grain(&place)).clamp(-self.bound(), self.bound())
    }

    /// About `distance` from the smooth surface less the height there, and exactly that where grain matters; far above the
    /// surface it is cheaper and shorter. The flag tells whether grain was looked at.
    fn clearance(&self, distance: f64, place: &Vector3<f64>) -> (f64, bool) {
        if distance > 1.5 * self.bound() {
            return (distance - self.bound(), false);
        }
        let place = askew(place);
        let undulation = self.undulation(&place);
        let grain_bound = self.scale * GRAIN_BOUND;
        if distance - undulation > 1.5 * grain_bound {
            return (distance - undulation - grain_bound, false);
        }
        let height = (undulation + self.grain(&place)).clamp(-self.bound(), self.bound());
        (distance - height, true)
    }

    fn undulation(&self, askew: &Vector3<f64>) -> f64 {
        let octave = |k: usize| {
            UNDULATION_SHARES[k] * noise(askew / UNDULATION_CELLS[k], self.seed.wrapping_add(k as u64))
        };
        self.scale * (octave(0) + octave(1))
    }

    fn grain(&self, askew: &Vector3<f64>) -> f64 {
        self.scale * GRAIN_SHARE * noise(askew / GRAIN_CELL, self.seed.wrapping_add(2))
    }

    /// Where a ray meets the surface between `from` and `to` metres along it: the first place at which `distance` (from
    /// the smooth surface, negative inside) is the height. Good to about a millimetre.
    pub(super) fn march(
        &self,
        from: f64,
        to: f64,
        at: impl Fn(f64) -> Vector3<f64>,
        distance: impl Fn(&Vector3<f64>) -> f64,
    ) -> Option<f64> {
        /// Slopes of undulation and of undulation with grain that few places exceed, against the scale.
        const SLOPES: [f64; 2] = [3.0, 9.0];
        const LEAST_STEP: f64 = 0.004;
        /// Way over which the first rate of approach is taken.
        const AHEAD: f64 = 0.01;
        const STEPS: u32 = 200;
        let exact = |t: f64| {
            let place = at(t);
            distance(&place) - self.height(&place)
        };
        let (mut t, mut place) = (from, at(from));
        let mut above = distance(&place);
        let (mut clear, mut grainy) = self.clearance(above, &place);
        if clear <= 0.0 {
            return Some(t);
        }
        // How fast the ray nears the smooth surface. Bodies are convex: it never gets faster.
        let mut rate = (above - distance(&at(t + AHEAD))) / AHEAD;
        for _ in 0..STEPS {
            let next =
                t + (clear / (rate.max(0.0) + SLOPES[usize::from(grainy)] * self.scale)).max(LEAST_STEP);
            if next > to {
                return None;
            }
            place = at(next);
            let above_next = distance(&place);
            let (clear_next, grainy_next) = self.clearance(above_next, &place);
            if clear_next <= 0.0 {
                let clear = if grainy { clear } else { exact(t) };
                return Some(crossing([t, next], clear, clear_next, exact));
            }
            rate = (above - above_next) / (next - t);
            (t, above, clear, grainy) = (next, above_next, clear_next, grainy_next);
        }
        // So flat along the surface that it never got away from it.
        Some(t)
    }
}

/// Where `clearance`, positive at the first and not at the second place, is zero: one step of the false position, then a
/// straight line.
fn crossing([mut a, mut b]: [f64; 2], mut at_a: f64, mut at_b: f64, clearance: impl Fn(f64) -> f64) -> f64 {
    let zero = |a: f64, b: f64, at_a: f64, at_b: f64| a + (b - a) * at_a / (at_a - at_b);
    let guess = zero(a, b, at_a, at_b);
    let clear = clearance(guess);
    if clear > 0.0 {
        (a, at_a) = (guess, clear);
    } else {
        (b, at_b) = (guess, clear);
    }
    zero(a, b, at_a, at_b)
}

/// Turned out of the building's axes: a wall must not run along the noise's lattice.
fn askew(p: &Vector3<f64>) -> Vector3<f64> {
    // Rows of a rotation (a multiple of 1/9 of whole numbers).
    Vector3::new(
        (p.x * 8.0 + p.y * 4.0 + p.z) / 9.0,
        (p.x * -4.0 + p.y * 7.0 + p.z * 4.0) / 9.0,
        (p.x + p.y * -4.0 + p.z * 8.0) / 9.0,
    )
}

/// Smooth noise in [-1, 1] with cells of edge 1.
fn noise(p: Vector3<f64>, seed: u64) -> f64 {
    // `f64::floor` is a call where the processor's own instruction may not be used.
    let floor = p.map(|x| x as i64 - i64::from(x < (x as i64) as f64));
    let part = p - floor.map(|x| x as f64);
    let step = part.map(|u| u * u * (3.0 - 2.0 * u));
    let [x, y, z] = [floor.x, floor.y, floor.z];
    let (xs, ys, zs) = (hashed(x, FACTORS[0]), hashed(y, FACTORS[1]), hashed(z, FACTORS[2]));
    let seed = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let corner = |dx: usize, dy: usize, dz: usize| finished(seed ^ xs[dx] ^ ys[dy] ^ zs[dz]);
    let along_x = |dy: usize, dz: usize| {
        let (a, b) = (corner(0, dy, dz), corner(1, dy, dz));
        a + (b - a) * step.x
    };
    let along_y = |dz: usize| {
        let (a, b) = (along_x(0, dz), along_x(1, dz));
        a + (b - a) * step.y
    };
    let (a, b) = (along_y(0), along_y(1));
    a + (b - a) * step.z
}

const FACTORS: [u64; 3] = [0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb, 0xd6e8_feb8_6659_fd93];

/// A coordinate of the lattice and the next one, spread over all bits.
fn hashed(coordinate: i64, factor: u64) -> [u64; 2] {
    let low = (coordinate as u64).wrapping_mul(factor);
    [low, low.wrapping_add(factor)]
}

/// Evenly distributed in [-1, 1), from a lattice point's mixed coordinates.
fn finished(h: u64) -> f64 {
    let h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    let h = (h ^ (h >> 29)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((h >> 11) as f64) * (1.0 / (1_u64 << 52) as f64) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_have_the_configured_root_mean_square_and_stay_within_the_bound() {
        let relief = Relief::new(0.02, 5).unwrap();
        let (mut sum, mut squares) = (0.0, 0.0);
        let n = 400;
        for i in 0..n {
            for k in 0..n {
                let place = Vector3::new(f64::from(i) * 0.171, 1.0, f64::from(k) * 0.193);
                let height = relief.height(&place);
                assert!(height.abs() <= relief.bound());
                sum += height;
                squares += height * height;
            }
        }
        let count = f64::from(n * n);
        assert!((sum / count).abs() < 0.001, "mean {} m", sum / count);
        assert!(((squares / count).sqrt() / 0.02 - 1.0).abs() < 0.05, "rms {} m", (squares / count).sqrt());
    }

    #[test]
    fn neighbours_agree_and_places_apart_do_not() {
        let relief = Relief::new(0.02, 5).unwrap();
        let correlation = |apart: f64| {
            let (mut product, mut square) = (0.0, 0.0);
            for k in 0..20_000 {
                let place = Vector3::new(f64::from(k) * 0.37, 0.3, f64::from(k % 7));
                let (a, b) = (relief.height(&place), relief.height(&(place + Vector3::x() * apart)));
                product += a * b;
                square += a * a;
            }
            product / square
        };
        assert!(correlation(0.005) > 0.9, "{}", correlation(0.005));
        let middle = correlation(0.2);
        assert!(middle > 0.4 && middle < 0.85, "{middle}");
        assert!(correlation(3.0).abs() < 0.1, "{}", correlation(3.0));
    }

    #[test]
    fn a_marched_ray_ends_on_the_surface() {
        let relief = Relief::new(0.015, 9).unwrap();
        for k in 0..500 {
            let way = Vector3::new(1.0, 0.05 + 0.002 * f64::from(k), 0.3).normalize();
            let start = Vector3::new(0.01 * f64::from(k), 0.0, 0.0);
            // A wall at y = 1.
            let range = relief.march(0.0, 100.0, |t| start + way * t, |p| 1.0 - p.y).unwrap();
            let place = start + way * range;
            let off = (1.0 - place.y) - relief.height(&place);
            assert!(off.abs() < 0.003, "{off} m off at incidence {}", way.y);
        }
    }
}
