//! The IMU inside the LiDAR: its records as samples, in order, the missing ones counted.

use evac_formats::livox_sdk1::ImuRecord;
use evac_frames::ImuSample;

/// The device gives specific force in g.
const ONE_G_M_S2: f64 = 9.80665;
/// Samples come 200 times a second, whichever the device.
const PERIOD_NS: i64 = 5_000_000;
/// A longer silence is no loss of single samples.
const PAUSE_NS: i64 = 1_000_000_000;

/// Samples on their way out.
#[derive(Debug, Default)]
pub(crate) struct OwnImu {
    /// Stamp of the newest sample, and whether the next one follows it on the same line.
    last: Option<(i64, bool)>,
    /// The newest sample.
    newest: ImuSample,
    /// Samples that never came.
    pub(crate) lost: u64,
}

impl OwnImu {
    /// A record that was measured at `stamp_ns` of the host's clock, in SI units and the IMU's own axes; `None` for one that came
    /// twice or was overtaken.
    pub(crate) fn sample(&mut self, record: &ImuRecord, stamp_ns: i64, arrival_ns: i64) -> Option<ImuSample> {
        if let Some((last_ns, follows)) = self.last {
            let since_ns = stamp_ns.saturating_sub(last_ns);
            if since_ns <= 0 {
                return None;
            }
            if follows && since_ns < PAUSE_NS {
                let periods = (since_ns + PERIOD_NS / 2) / PERIOD_NS;
                self.lost += (periods - 1).max(0).unsigned_abs();
            }
        }
        self.last = Some((stamp_ns, true));
        self.newest = ImuSample {
            stamp_ns,
            arrival_ns,
            gyro: record.gyro.map(f64::from),
            accel: record.accel_g.map(|value| f64::from(value) * ONE_G_M_S2),
            ..ImuSample::default()
        };
        Some(self.newest)
    }

    /// The device was away or its clock was set: what lies between the last sample and the next is no loss.
    pub(crate) fn pause(&mut self) {
        if let Some((_, follows)) = &mut self.last {
            *follows = false;
        }
    }

    /// The newest sample.
    pub(crate) fn newest(&self) -> ImuSample {
        self.newest
    }
}

/// Whether all values are numbers.
pub(crate) fn is_finite(record: &ImuRecord) -> bool {
    record.gyro.iter().chain(&record.accel_g).all(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECORD: ImuRecord = ImuRecord { gyro: [0.5, 0.0, -0.25], accel_g: [0.0, 0.0, 1.0] };

    #[test]
    fn units_are_si_samples_rise_and_the_missing_ones_are_counted_but_not_over_a_pause() {
        let mut imu = OwnImu::default();
        let sample = imu.sample(&RECORD, 100 * PERIOD_NS, 1).unwrap();
        assert_eq!((sample.gyro, sample.accel), ([0.5, 0.0, -0.25], [0.0, 0.0, 9.80665]));
        for (period, taken, lost) in [(101, true, 0), (101, false, 0), (100, false, 0), (105, true, 3)] {
            // A device's own clock is off by some millionths, and the host's fit by some more.
            let stamp_ns = period * PERIOD_NS + if taken { 40_000 } else { 0 };
            assert_eq!((imu.sample(&RECORD, stamp_ns, 2).is_some(), imu.lost), (taken, lost), "{period}");
        }
        imu.pause();
        assert!(imu.sample(&RECORD, 120 * PERIOD_NS, 3).is_some());
        assert!(imu.sample(&RECORD, 1120 * PERIOD_NS, 4).is_some());
        assert_eq!(imu.lost, 3);
        assert!(!is_finite(&ImuRecord { gyro: [0.0, f32::NAN, 0.0], ..RECORD }));
    }
}
