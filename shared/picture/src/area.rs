//! Places on a chart, in pixels that may be fractions, y down.

/// A rectangle on a chart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Area {
    pub(crate) left: f64,
    pub(crate) top: f64,
    pub(crate) right: f64,
    pub(crate) bottom: f64,
}

impl Area {
    pub(crate) fn width(&self) -> f64 {
        self.right - self.left
    }

    pub(crate) fn height(&self) -> f64 {
        self.bottom - self.top
    }

    pub(crate) fn grown(&self, by: f64) -> Self {
        Self { left: self.left - by, top: self.top - by, right: self.right + by, bottom: self.bottom + by }
    }

    /// The part of a segment inside (Liang and Barsky 1984).
    pub(crate) fn clip(&self, a: [f64; 2], b: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        let along = [b[0] - a[0], b[1] - a[1]];
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        let borders = [
            (-along[0], a[0] - self.left),
            (along[0], self.right - a[0]),
            (-along[1], a[1] - self.top),
            (along[1], self.bottom - a[1]),
        ];
        for (outward, room) in borders {
            if outward == 0.0 {
                if room < 0.0 {
                    return None;
                }
            } else if outward < 0.0 {
                from = from.max(room / outward);
            } else {
                to = to.min(room / outward);
            }
        }
        let at = |share: f64| [a[0] + along[0] * share, a[1] + along[1] * share];
        (from <= to).then(|| [at(from), at(to)])
    }
}

/// Data coordinates on an area: x to the right, y up.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub(crate) area: Area,
    /// Data at the left and right border.
    pub(crate) x: [f64; 2],
    /// Data at the lower and upper border.
    pub(crate) y: [f64; 2],
}

impl View {
    pub(crate) fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let share = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        [
            self.area.left + share(x, self.x) * self.area.width(),
            self.area.bottom - share(y, self.y) * self.area.height(),
        ]
    }
}

/// The range of finite values, at least `min_span` wide, and a little more at both ends.
pub(crate) fn range(values: impl Iterator<Item = f64>, min_span: f64, margin: f64) -> [f64; 2] {
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let [low, high] = if low <= high { [low, high] } else { [0.0, 1.0] };
    // A range without width, also one lost to rounding, could not be drawn.
    let least = min_span.max(1e-9 * low.abs().max(high.abs())).max(1e-12);
    let (middle, span) = (f64::midpoint(low, high), (high - low).max(least));
    let half = span * (0.5 + margin);
    [middle - half, middle + half]
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Area = Area { left: 0.0, top: 0.0, right: 10.0, bottom: 10.0 };

    #[test]
    fn a_segment_through_the_area_is_cut_at_its_borders() {
        assert_eq!(AREA.clip([-10.0, 5.0], [20.0, 5.0]), Some([[0.0, 5.0], [10.0, 5.0]]));
        assert_eq!(AREA.clip([5.0, 5.0], [5.0, 1e12]), Some([[5.0, 5.0], [5.0, 10.0]]));
        assert_eq!(AREA.clip([-5.0, 0.0], [0.0, 20.0]), None);
        assert_eq!(AREA.clip([-5.0, 3.0], [-5.0, 4.0]), None);
    }

    #[test]
    fn a_range_has_width_whatever_the_values_are() {
        for values in [&[][..], &[3.0], &[1e9, 1e9], &[f64::NAN, f64::INFINITY], &[-0.0, 0.0]] {
            let [low, high] = range(values.iter().copied(), 0.0, 0.05);
            assert!(low < high && low.is_finite() && high.is_finite(), "{values:?}: {low} {high}");
        }
        assert_eq!(range([0.0, 10.0].into_iter(), 0.0, 0.1), [-1.0, 11.0]);
        assert_eq!(range([4.9, 5.1].into_iter(), 2.0, 0.0), [4.0, 6.0]);
    }

    #[test]
    fn y_grows_upwards() {
        let view = View { area: AREA, x: [0.0, 1.0], y: [0.0, 2.0] };
        assert_eq!(view.place([0.5, 2.0]), [5.0, 0.0]);
    }
}
