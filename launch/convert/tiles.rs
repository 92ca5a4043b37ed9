//! Points of one place after another: what is looked up for one is then at hand for the next.

/// Edge of a tile, metres, where the cloud is not larger than [`MOST`] of them: about a cell of the ground filter.
const TILE_M: f32 = 0.25;
/// Most tiles along a side.
const MOST: f32 = 1024.0;

/// Orders points by tiles of the xy plane, in linear time. Those of a tile keep their order.
pub(super) fn arranged(points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for point in points.iter().filter(|point| point[0].is_finite() && point[1].is_finite()) {
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let extent = (high[0] - low[0]).max(high[1] - low[1]).max(0.0);
    let edge = TILE_M.max(extent / (MOST - 2.0));
    // Tiles of the ground filter's size are its cells, which begin at zero.
    let low = low.map(|low| (low / edge).floor() * edge);
    // Casts saturate, and take NaN for 0: points without numbers come first.
    let column = |value: f32, low: f32| (((value - low) / edge) as usize).min(MOST as usize - 1);
    let tile = |point: &[f32; 3]| column(point[1], low[1]) * MOST as usize + column(point[0], low[0]);
    let mut starts = vec![0_u32; (MOST * MOST) as usize + 1];
    for point in points {
        starts[tile(point) + 1] += 1;
    }
    let mut sum = 0;
    for start in &mut starts {
        sum += *start;
        *start = sum;
    }
    let mut arranged = vec![[0.0; 3]; points.len()];
    for point in points {
        let next = &mut starts[tile(point)];
        arranged[*next as usize] = *point;
        *next += 1;
    }
    arranged
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_stays_and_those_of_a_tile_come_together() {
        let points: Vec<[f32; 3]> = (0..1000)
            .map(|i| match i % 100 {
                0 => [f32::NAN, f32::INFINITY, i as f32],
                _ => [(i * 7919 % 400) as f32 / 100.0 - 2.0, (i * 104_729 % 300) as f32 / 100.0, i as f32],
            })
            .collect();
        let arranged = arranged(&points);
        let numbers = |points: &[[f32; 3]]| points.iter().map(|point| point[2] as u32).collect::<Vec<_>>();
        let mut sorted = numbers(&arranged);
        sorted.sort_unstable();
        assert_eq!(sorted, numbers(&points));
        let changes = |points: &[[f32; 3]]| {
            points.windows(2).filter(|pair| (pair[0][0] - pair[1][0]).abs() > 2.0 * TILE_M).count()
        };
        assert!(changes(&arranged) * 2 < changes(&points));
        assert!(super::arranged(&[]).is_empty());
    }
}
