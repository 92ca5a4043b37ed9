//! A labelled building of rectangles, and a sensor that sees it: nearest hit a ray, noise along the ray, strays, drop-outs.
#![allow(dead_code)]

/// What a point was seen on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Floor,
    Ramp,
    Platform,
    Landing,
    Stairs,
    Wall,
    Furniture,
    Ceiling,
    /// A return out of the air.
    Stray,
}

impl Kind {
    pub(crate) fn is_ground(self) -> bool {
        matches!(self, Self::Floor | Self::Ramp | Self::Platform | Self::Landing)
    }
}

struct Rectangle {
    corner: [f64; 3],
    sides: [[f64; 3]; 2],
    kind: Kind,
}

pub(crate) struct Scene(Vec<Rectangle>);

impl Scene {
    /// A concourse at 0 m with walls, pillars, tables and benches, a track bed at -1.1 m beside it, stairs of twelve steps
    /// to a landing at 2.04 m, and a ramp of `ramp_deg` over 6 m to a platform.
    pub(crate) fn station(ramp_deg: f64) -> Self {
        let mut scene = Self(Vec::new());
        scene.flat([0.0, 16.0], [0.0, 8.0], 0.0, Kind::Floor);
        scene.flat([0.0, 16.0], [-4.0, 0.0], -1.1, Kind::Floor);
        scene.wall([0.0, 0.0], [16.0, 0.0], [-1.1, 0.0]);
        for (from, to) in [
            ([0.0, -4.0], [30.0, -4.0]),
            ([0.0, 8.0], [30.0, 8.0]),
            ([0.0, -4.0], [0.0, 8.0]),
            ([30.0, -4.0], [30.0, 8.0]),
        ] {
            scene.wall(from, to, [-1.1, 4.5]);
        }
        scene.flat([0.0, 30.0], [-4.0, 8.0], 4.5, Kind::Ceiling);
        let (tread, riser) = (0.28, 0.17);
        for step in 0..12 {
            let (x, z) = (16.0 + tread * f64::from(step), riser * f64::from(step));
            scene.put([x, 1.0, z], [0.0, 2.0, 0.0], [0.0, 0.0, riser], Kind::Stairs);
            if step < 11 {
                scene.flat([x, x + tread], [1.0, 3.0], z + riser, Kind::Stairs);
            }
        }
        scene.flat([16.0 + 11.0 * tread, 22.0], [0.5, 4.0], 12.0 * riser, Kind::Landing);
        let rise = 6.0 * ramp_deg.to_radians().tan();
        scene.put([16.0, 5.0, 0.0], [6.0, 0.0, rise], [0.0, 2.5, 0.0], Kind::Ramp);
        scene.flat([22.0, 29.0], [4.5, 8.0], rise, Kind::Platform);
        for [x, y] in [[4.0, 2.0], [10.0, 5.0]] {
            scene.block([x, y], [0.5, 0.5], [0.0, 4.5], Kind::Wall);
        }
        scene.flat([5.0, 6.4], [6.0, 6.8], 0.74, Kind::Furniture);
        scene.flat([12.0, 14.4], [6.4, 7.6], 0.74, Kind::Furniture);
        scene.block([7.0, 0.8], [1.8, 0.5], [0.0, 0.45], Kind::Furniture);
        scene.block([24.0, 7.0], [1.8, 0.5], [rise, rise + 0.45], Kind::Furniture);
        scene
    }

    fn put(&mut self, corner: [f64; 3], a: [f64; 3], b: [f64; 3], kind: Kind) {
        self.0.push(Rectangle { corner, sides: [a, b], kind });
    }

    fn flat(&mut self, x: [f64; 2], y: [f64; 2], z: f64, kind: Kind) {
        self.put([x[0], y[0], z], [x[1] - x[0], 0.0, 0.0], [0.0, y[1] - y[0], 0.0], kind);
    }

    fn wall(&mut self, from: [f64; 2], to: [f64; 2], z: [f64; 2]) {
        let along = [to[0] - from[0], to[1] - from[1], 0.0];
        self.put([from[0], from[1], z[0]], along, [0.0, 0.0, z[1] - z[0]], Kind::Wall);
    }

    fn block(&mut self, [x, y]: [f64; 2], [w, d]: [f64; 2], z: [f64; 2], kind: Kind) {
        for (from, along) in
            [([x, y], [w, 0.0]), ([x, y + d], [w, 0.0]), ([x, y], [0.0, d]), ([x + w, y], [0.0, d])]
        {
            let along = [along[0], along[1], 0.0];
            self.put([from[0], from[1], z[0]], along, [0.0, 0.0, z[1] - z[0]], kind);
        }
        self.flat([x, x + w], [y, y + d], z[1], kind);
    }

    /// Nearest hit of a ray, metres along `ray` (of length 1), and what it is on.
    fn cast(&self, from: [f64; 3], ray: [f64; 3]) -> Option<(f64, Kind)> {
        let hits = self.0.iter().filter_map(|rectangle| {
            let [a, b] = rectangle.sides;
            let normal = cross(a, b);
            let apart = sub(rectangle.corner, from);
            let range = dot(apart, normal) / dot(ray, normal);
            let inside = sub(std::array::from_fn(|k| range * ray[k]), apart);
            let [s, t] = [a, b].map(|side| dot(inside, side) / dot(side, side));
            let hit = range > 0.0 && (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
            hit.then_some((range, rectangle.kind))
        });
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// A scan of `shots` rays in a cone of 38.4 degrees around a heading: 2 cm of noise along the ray, 0.3 % strays, 2 %
    /// without return, as the simulator and the data sheet of a Mid-40 have it.
    pub(crate) fn scan(
        &self,
        from: [f64; 3],
        yaw_deg: f64,
        pitch_deg: f64,
        shots: u32,
        random: &mut Random,
    ) -> Vec<([f32; 3], Kind)> {
        let (sy, cy) = yaw_deg.to_radians().sin_cos();
        let (sp, cp) = pitch_deg.to_radians().sin_cos();
        let half = 19.2f64.to_radians();
        let mut points = Vec::new();
        for _ in 0..shots {
            let (angle, off) = (random.uniform() * std::f64::consts::TAU, half * random.uniform().sqrt());
            let (u, v, w) = (off.cos(), off.sin() * angle.cos(), off.sin() * angle.sin());
            let (forward, up) = (u * cp - w * sp, u * sp + w * cp);
            let ray = [forward * cy - v * sy, forward * sy + v * cy, up];
            let Some((range, kind)) = self.cast(from, ray) else { continue };
            if random.uniform() < 0.02 {
                continue;
            }
            let (range, kind) = if random.uniform() < 0.003 {
                (0.5 + random.uniform() * (range - 0.5), Kind::Stray)
            } else {
                (range + 0.02 * random.gauss(), kind)
            };
            points.push((std::array::from_fn(|k| (from[k] + range * ray[k]) as f32), kind));
        }
        points
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// SplitMix64.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Mean 0, deviation 1.
    pub(crate) fn gauss(&mut self) -> f64 {
        (0..12).map(|_| self.uniform() - 0.5).sum()
    }
}
