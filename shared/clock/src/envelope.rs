//! The earliest arrival of each stretch of a window, and the line under them.

/// Stretches that are kept.
const STRETCHES: usize = 64;
/// Length of a stretch at a segment's start, nanoseconds; they double until the window is reached.
const FIRST_STRETCH_NS: f64 = 25_000_000.0;
/// How far the earliest arrivals lie off a line, nanoseconds: what a slope over a short time is trusted by.
const JITTER_NS: f64 = 300_000.0;

/// What a clock's rate may have changed by since the segment before.
const KNOWN_TOLERANCE: f64 = 100e-6;

/// Device time (nanoseconds since the segment's start at the nominal rate) and how much later than that it arrived.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Arrival {
    pub(crate) device_ns: f64,
    pub(crate) delay_ns: f64,
}

/// Delay as a line over device time.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Line {
    pub(crate) at_zero_ns: f64,
    /// Nanoseconds per nanosecond.
    pub(crate) slope: f64,
}

impl Line {
    pub(crate) fn at(&self, device_ns: f64) -> f64 {
        self.at_zero_ns + self.slope * device_ns
    }
}

/// Lower envelope of a sliding window.
#[derive(Debug, Clone)]
pub(crate) struct Envelope {
    earliest: [Arrival; STRETCHES],
    filled: usize,
    /// End of the newest stretch.
    until_ns: f64,
    stretch_ns: f64,
    window_ns: f64,
    /// Time after which a slope outweighs what was known before.
    trust_ns: f64,
    largest_slope: f64,
    /// The slope before there was data: 0, or that of the segment before.
    known_slope: f64,
    line: Line,
}

impl Envelope {
    pub(crate) fn new(window_ns: f64, tolerance_ppm: f64) -> Self {
        let tolerance = (tolerance_ppm * 1e-6).max(1e-9);
        Self {
            earliest: [Arrival::default(); STRETCHES],
            filled: 0,
            until_ns: f64::NEG_INFINITY,
            stretch_ns: FIRST_STRETCH_NS.min(window_ns / STRETCHES as f64),
            window_ns,
            trust_ns: JITTER_NS / tolerance,
            largest_slope: 5.0 * tolerance,
            known_slope: 0.0,
            line: Line::default(),
        }
    }

    /// Forgets all arrivals; the rate of the clock stays known.
    pub(crate) fn restart(&mut self) {
        if self.span_ns() > self.window_ns / 8.0 {
            self.known_slope = self.line.slope;
            self.trust_ns = self.trust_ns.max(JITTER_NS / KNOWN_TOLERANCE);
        }
        self.filled = 0;
        self.until_ns = f64::NEG_INFINITY;
        self.stretch_ns = FIRST_STRETCH_NS.min(self.window_ns / STRETCHES as f64);
        self.line = Line { at_zero_ns: 0.0, slope: self.known_slope };
    }

    pub(crate) fn line(&self) -> Line {
        self.line
    }

    /// Device time that the window holds, nanoseconds.
    pub(crate) fn span_ns(&self) -> f64 {
        match self.kept() {
            [first, .., last] => last.device_ns - first.device_ns,
            _ => 0.0,
        }
    }

    /// Root mean square of how far the earliest arrivals lie above the line, nanoseconds.
    pub(crate) fn roughness_ns(&self) -> f64 {
        let kept = self.kept();
        let above = |arrival: &Arrival| (arrival.delay_ns - self.line.at(arrival.device_ns)).powi(2);
        (kept.iter().map(above).sum::<f64>() / kept.len().max(1) as f64).sqrt()
    }

    /// Takes in an arrival; device times rise.
    pub(crate) fn add(&mut self, arrival: Arrival) {
        if arrival.device_ns >= self.until_ns {
            self.begin_stretch(arrival);
            self.fit();
            return;
        }
        let slope = self.line.slope;
        let level = |arrival: &Arrival| arrival.delay_ns - slope * arrival.device_ns;
        if let Some(newest) = self.earliest.get_mut(self.filled.wrapping_sub(1))
            && level(&arrival) < level(newest)
        {
            *newest = arrival;
            if level(&arrival) < self.line.at_zero_ns {
                self.fit();
            }
        }
    }

    fn kept(&self) -> &[Arrival] {
        self.earliest.get(..self.filled).unwrap_or_default()
    }

    fn begin_stretch(&mut self, arrival: Arrival) {
        let oldest_ns = arrival.device_ns - self.window_ns;
        let old = self.kept().iter().take_while(|kept| kept.device_ns < oldest_ns).count();
        self.drop_oldest(old);
        if self.filled == STRETCHES {
            if self.stretch_ns * (STRETCHES as f64) < self.window_ns {
                self.merge_pairs();
            } else {
                self.drop_oldest(1);
            }
        }
        if let Some(slot) = self.earliest.get_mut(self.filled) {
            *slot = arrival;
            self.filled += 1;
        }
        self.until_ns = arrival.device_ns + self.stretch_ns;
    }

    fn drop_oldest(&mut self, count: usize) {
        self.earliest.copy_within(count.min(self.filled)..self.filled, 0);
        self.filled -= count.min(self.filled);
    }

    fn merge_pairs(&mut self) {
        let slope = self.line.slope;
        let level = |arrival: Arrival| arrival.delay_ns - slope * arrival.device_ns;
        for pair in 0..STRETCHES / 2 {
            let (first, second) = (self.earliest[2 * pair], self.earliest[2 * pair + 1]);
            self.earliest[pair] = if level(second) < level(first) { second } else { first };
        }
        self.filled = STRETCHES / 2;
        self.stretch_ns *= 2.0;
    }

    /// The line under all arrivals: the slope of the hull's edge over the window's middle, drawn towards what was known
    /// before by as much as a short window cannot tell, and as high as the arrivals allow.
    fn fit(&mut self) {
        let span_ns = self.span_ns();
        let trust = span_ns.powi(2) / (span_ns.powi(2) + self.trust_ns.powi(2));
        let seen = self.hull_slope().unwrap_or(self.known_slope);
        let slope = (self.known_slope + trust * (seen - self.known_slope))
            .clamp(-self.largest_slope, self.largest_slope);
        let lowest = self.kept().iter().map(|kept| kept.delay_ns - slope * kept.device_ns);
        let at_zero_ns = lowest.fold(f64::INFINITY, f64::min);
        if at_zero_ns.is_finite() {
            self.line = Line { at_zero_ns, slope };
        }
    }

    /// Slope of the lower convex hull's edge over the middle of the window.
    fn hull_slope(&self) -> Option<f64> {
        let mut hull = [Arrival::default(); STRETCHES];
        let mut corners = 0;
        for arrival in self.kept() {
            // A corner above the line from the one before it to the new arrival is none.
            while corners >= 2
                && slope(hull[corners - 2], hull[corners - 1]) >= slope(hull[corners - 2], *arrival)
            {
                corners -= 1;
            }
            hull[corners] = *arrival;
            corners += 1;
        }
        let hull = hull.get(..corners)?;
        let (first, last) = (hull.first()?, hull.last()?);
        let middle_ns = (first.device_ns + last.device_ns) / 2.0;
        let edge = hull.windows(2).find(|edge| edge[1].device_ns >= middle_ns)?;
        Some(slope(edge[0], edge[1]))
    }
}

fn slope(from: Arrival, to: Arrival) -> f64 {
    (to.delay_ns - from.delay_ns) / (to.device_ns - from.device_ns).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_lies_under_every_arrival_of_the_window_and_touches_one() {
        let mut envelope = Envelope::new(10e9, 5000.0);
        let mut seen = Vec::new();
        for n in 0..4000 {
            let device_ns = f64::from(n) * 5e6;
            let delay_ns = 3e6 + 40e-6 * device_ns + f64::from(n * 7919 % 1601) * 1e4;
            envelope.add(Arrival { device_ns, delay_ns });
            seen.push(Arrival { device_ns, delay_ns });
        }
        let line = envelope.line();
        let newest = seen.last().unwrap().device_ns;
        let above = seen
            .iter()
            .filter(|arrival| arrival.device_ns > newest - 9.5e9)
            .map(|arrival| arrival.delay_ns - line.at(arrival.device_ns));
        let least = above.fold(f64::INFINITY, f64::min);
        assert!((-1.0..20_000.0).contains(&least), "{least}");
        assert!((line.slope - 40e-6).abs() < 5e-6, "{}", line.slope);
        assert!(envelope.span_ns() <= 10e9 && envelope.span_ns() > 9e9);
    }
}
