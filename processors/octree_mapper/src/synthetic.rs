//! Synthetic surfaces for tests: seeded noise and sampled rectangles.

/// A small generator (SplitMix64) with the seed at the call site.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in `low..high`.
    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Mean 0, deviation 1 (sum of twelve uniforms).
    pub(crate) fn gauss(&mut self) -> f32 {
        (0..12).map(|_| self.between(-0.5, 0.5)).sum()
    }
}

/// `density` points a square metre on the parallelogram `corner + s * a + t * b`, with `noise` metres on every axis.
pub(crate) fn sheet(
    corner: [f32; 3],
    a: [f32; 3],
    b: [f32; 3],
    density: f32,
    noise: f32,
    random: &mut Random,
) -> Vec<[f32; 3]> {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let area = cross.iter().map(|x| x * x).sum::<f32>().sqrt();
    (0..(area * density) as usize)
        .map(|_| {
            let (s, t) = (random.between(0.0, 1.0), random.between(0.0, 1.0));
            std::array::from_fn(|k| corner[k] + s * a[k] + t * b[k] + noise * random.gauss())
        })
        .collect()
}
