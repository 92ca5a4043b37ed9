//! How fast a device shoots, where its packets do not say so.

/// Mid-40, Mid-70: 100,000 shots a second. Horizon, Tele-15, Avia: 240,000.
const RATES_NS: [f64; 2] = [10_000.0, 4166.7];

/// Tells the time between shots from the shortest time between packets: losses only make it longer.
#[derive(Debug, Default)]
pub(crate) struct ShotTime {
    last_ns: Option<i64>,
    shortest_ns: Option<f64>,
}

impl ShotTime {
    /// Takes in a packet of `shots` shots.
    pub(crate) fn seen(&mut self, stamp_ns: i64, shots: usize) {
        if let Some(last) = self.last_ns.replace(stamp_ns)
            && (1..50_000_000).contains(&stamp_ns.saturating_sub(last))
        {
            let between = stamp_ns.saturating_sub(last) as f64 / shots.max(1) as f64;
            self.shortest_ns = Some(self.shortest_ns.map_or(between, |shortest| shortest.min(between)));
        }
    }

    /// Nanoseconds between two shots.
    pub(crate) fn nanoseconds(&self) -> f64 {
        let shortest = self.shortest_ns.unwrap_or(RATES_NS[0]);
        RATES_NS
            .into_iter()
            .min_by(|a, b| (a - shortest).abs().total_cmp(&(b - shortest).abs()))
            .unwrap_or(shortest)
    }

    /// Another device may have another rate.
    pub(crate) fn forget(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn real_spacings_with_losses_give_the_nominal_rates() {
        for (packet_ns, shots, expected) in
            [(1_000_000, 100, 10_000.0), (399_360, 96, 4166.7), (960_000, 96, 10_000.0)]
        {
            let mut time = ShotTime::default();
            for n in [0, 1, 2, 5, 6, 9] {
                time.seen(n * packet_ns + n % 3 * 900, shots);
            }
            assert_eq!(time.nanoseconds(), expected);
        }
    }
}
