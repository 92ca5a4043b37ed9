//! Sixteen walks along rays of one origin, side by side in vector registers.

use crate::rays::Origin;

/// Walks side by side.
pub(crate) const LANES: usize = 16;

/// The state of the walks, by axis and lane.
pub(crate) struct Lanes {
    /// Path lengths, metres, at which each ray next crosses a border of the axis.
    pub(crate) crossing: [[f64; LANES]; 3],
    /// Path length between two borders of the axis, metres.
    pub(crate) spacing: [[f64; LANES]; 3],
    /// The axis' bits of the code of the voxel where the walk is.
    pub(crate) code: [[u64; LANES]; 3],
    /// What a step along the axis adds to them.
    pub(crate) step: [[u64; LANES]; 3],
}

/// Starts walks to these `ends`, metres in the map frame, and lets each pass as many voxels as `passed` has places for
/// their codes. Gives the walks as they are then and the rays' lengths.
#[inline]
pub(crate) fn march(
    from: &Origin,
    ends: &[[f32; 3]; LANES],
    passed: &mut [[u64; LANES]],
) -> (Lanes, [f32; LANES]) {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512dq") {
            #[expect(unsafe_code, reason = "a function for a processor that has more than the baseline")]
            // SAFETY: the features that the function is compiled for have just been found.
            return unsafe { march_avx512(from, ends, passed) };
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            #[expect(unsafe_code, reason = "a function for a processor that has more than the baseline")]
            // SAFETY: the feature that the function is compiled for has just been found.
            return unsafe { march_avx2(from, ends, passed) };
        }
    }
    march_baseline(from, ends, passed)
}

/// The same code for registers of eight numbers, two of which hide each other's latency. Rust never fuses a product and a sum, so all give the same bits.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq")]
fn march_avx512(
    from: &Origin,
    ends: &[[f32; 3]; LANES],
    passed: &mut [[u64; LANES]],
) -> (Lanes, [f32; LANES]) {
    march_baseline(from, ends, passed)
}

/// The same for registers of four.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn march_avx2(from: &Origin, ends: &[[f32; 3]; LANES], passed: &mut [[u64; LANES]]) -> (Lanes, [f32; LANES]) {
    march_baseline(from, ends, passed)
}

#[inline(always)]
fn march_baseline(
    from: &Origin,
    ends: &[[f32; 3]; LANES],
    passed: &mut [[u64; LANES]],
) -> (Lanes, [f32; LANES]) {
    let (mut lanes, lengths) = Lanes::new(from, ends);
    for codes in passed {
        lanes.advance(from.masks, codes);
    }
    (lanes, lengths)
}

impl Lanes {
    /// The starts of walks, and the rays' lengths, rounded as [`crate::trace::direction_and_length`] does. Components that
    /// are no numbers (a ray too short for its length) never arrive.
    #[inline(always)]
    fn new(from: &Origin, ends: &[[f32; 3]; LANES]) -> (Self, [f32; LANES]) {
        let mut along = [[0.0_f32; LANES]; 3];
        for lane in 0..LANES {
            for axis in 0..3 {
                along[axis][lane] = ends[lane][axis] - from.point[axis];
            }
        }
        let mut lengths = [0.0_f32; LANES];
        for lane in 0..LANES {
            let [x, y, z] = [along[0][lane], along[1][lane], along[2][lane]];
            lengths[lane] = f64::from(x * x + y * y + z * z).sqrt() as f32;
        }
        let mut lanes = Self {
            crossing: [[f64::MAX; LANES]; 3],
            spacing: [[f64::MAX; LANES]; 3],
            code: from.codes.map(|code| [code; LANES]),
            step: [[0; LANES]; 3],
        };
        let resolution = from.space.resolution();
        for axis in 0..3 {
            let ([behind, ahead], [back, forth]) = (from.borders[axis], from.steps[axis]);
            for lane in 0..LANES {
                let along = f64::from(along[axis][lane] / lengths[lane]);
                let (forward, moves) = (along > 0.0, along != 0.0);
                let crossing = (if forward { ahead } else { behind }) / along;
                let spacing = resolution / along.abs();
                lanes.crossing[axis][lane] = if moves { crossing } else { f64::MAX };
                lanes.spacing[axis][lane] = if moves { spacing } else { f64::MAX };
                lanes.step[axis][lane] = if forward { forth } else { back } & mask(moves);
            }
        }
        (lanes, lengths)
    }

    /// Each walk goes to its next voxel: along x where its border is first, y where it is before z, z among equals, as
    /// OctoMap decides. Selections are masks, since the choice is as good as random.
    #[inline(always)]
    fn advance(&mut self, masks: [u64; 3], codes: &mut [u64; LANES]) {
        let Self { crossing: [x, y, z], spacing: [dx, dy, dz], code: [cx, cy, cz], step: [sx, sy, sz] } =
            self;
        for lane in 0..LANES {
            codes[lane] = cx[lane] | cy[lane] | cz[lane];
            let x_before_y = mask(x[lane] < y[lane]);
            let along_x = x_before_y & mask(x[lane] < z[lane]);
            let along_y = !x_before_y & mask(y[lane] < z[lane]);
            let along_z = !(along_x | along_y);
            x[lane] += f64::from_bits(dx[lane].to_bits() & along_x);
            y[lane] += f64::from_bits(dy[lane].to_bits() & along_y);
            z[lane] += f64::from_bits(dz[lane].to_bits() & along_z);
            cx[lane] = cx[lane].wrapping_add(sx[lane] & along_x) & masks[0];
            cy[lane] = cy[lane].wrapping_add(sy[lane] & along_y) & masks[1];
            cz[lane] = cz[lane].wrapping_add(sz[lane] & along_z) & masks[2];
        }
    }
}

/// All bits or none.
#[inline(always)]
fn mask(condition: bool) -> u64 {
    u64::from(condition).wrapping_neg()
}
