//! `sensor_msgs/Imu`, in whichever unit it was published.

use std::path::PathBuf;

use evac_formats::FormatError;
use evac_formats::bag::{Bag, Messages};
use evac_formats::ros::Imu;
use evac_frames::ImuSample;
use evac_geometry::{GyroScale, GyroScaleCheck};
use evac_stage::{Counters, StageError};

use super::bad_message;
use super::topics::Topic;
use crate::source::file;
use crate::streams::{ImuStream, imu_sample};
use crate::{Config, GyroUnit, ImuUnit};

/// Samples by which the unit is told: two seconds at 200 Hz.
const UNIT_SAMPLES: usize = 400;
/// Samples by which the gyroscope's scale is told: a minute at 200 Hz.
const SCALE_SAMPLES: usize = 12_000;

/// IMU messages in the order of the bag; one whose stamp does not rise is left out.
pub(super) struct BagImu {
    samples: Samples,
    /// m/s^2 of one unit of the messages.
    unit: f64,
    /// rad/s of one unit of the messages.
    gyro_unit: f64,
    offset_ns: i64,
    first_ns: i64,
    last_ns: Option<i64>,
    late: u64,
    /// Messages with a value that is not finite.
    rejected: u64,
    /// The end was reached and what was left out is in the log.
    told: bool,
}

struct Samples {
    path: PathBuf,
    topic: Topic,
    messages: Messages,
}

impl BagImu {
    pub(super) fn open(bag: &Bag, topic: Topic, config: &Config) -> Result<Self, StageError> {
        let open = || Samples {
            path: bag.path().to_owned(),
            topic: topic.clone(),
            messages: Messages::new(bag, &topic.connections),
        };
        let (mut first, mut norms, mut ahead) = (None, Vec::with_capacity(UNIT_SAMPLES), open());
        while norms.len() < UNIT_SAMPLES {
            let Some(ImuSample { stamp_ns, accel, .. }) = ahead.next().map_err(file)? else { break };
            first = first.or(Some(stamp_ns));
            norms.push(accel.iter().map(|a| a * a).sum::<f64>().sqrt());
        }
        let unit = match config.imu_unit {
            ImuUnit::MetresPerSecondSquared => 1.0,
            ImuUnit::G => config.one_g_m_s2,
            ImuUnit::Auto => {
                let norm = median(&mut norms);
                let (unit, name) = unit_of(norm, config.one_g_m_s2).ok_or_else(|| {
                    StageError::File(format!(
                        "{}: specific force on {} has a median length of {norm:.3}, neither about 1 (g) nor about 9.8 \
                         (m/s^2); set imu_unit",
                        bag.path().display(),
                        topic.name
                    ))
                })?;
                tracing::info!(
                    "{}: {} has a median specific force of {norm:.3}, so its unit is {name}",
                    bag.path().display(),
                    topic.name
                );
                unit
            }
        };
        let gyro_unit = match config.gyro_unit {
            GyroUnit::RadiansPerSecond => 1.0,
            GyroUnit::DegreesPerSecond => 1_f64.to_radians(),
            GyroUnit::Auto => gyro_unit_of(open(), config.one_g_m_s2 / unit)?,
        };
        let (offset_ns, samples) = (config.imu_offset_ns(), open());
        let first_ns = first.unwrap_or_default().saturating_add(offset_ns);
        Ok(Self {
            samples,
            unit,
            gyro_unit,
            offset_ns,
            first_ns,
            last_ns: None,
            late: 0,
            rejected: 0,
            told: false,
        })
    }

    pub(super) fn first_ns(&self) -> i64 {
        self.first_ns
    }

    fn tell(&self) {
        let (file, topic) = (self.samples.path.display(), &self.samples.topic.name);
        for (number, what) in
            [(self.late, "whose stamps do not rise"), (self.rejected, "with values that are not finite")]
        {
            if number > 0 {
                tracing::warn!("{file}: left out {number} messages on {topic} {what}");
            }
        }
    }
}

impl ImuStream for BagImu {
    fn next_sample(&mut self) -> Result<Option<ImuSample>, FormatError> {
        while let Some(ImuSample { stamp_ns, gyro, accel, .. }) = self.samples.next()? {
            if self.last_ns.is_some_and(|last| stamp_ns <= last) {
                self.late += 1;
                continue;
            }
            self.last_ns = Some(stamp_ns);
            let stamp_ns = stamp_ns.saturating_add(self.offset_ns);
            let gyro = gyro.map(|value| value * self.gyro_unit);
            let sample = imu_sample(stamp_ns, gyro, accel.map(|value| value * self.unit));
            if sample.is_some() {
                return Ok(sample);
            }
            self.rejected += 1;
        }
        if !std::mem::replace(&mut self.told, true) {
            self.tell();
        }
        Ok(None)
    }

    fn counters(&self) -> Counters {
        Counters { late: self.late, rejected: self.rejected, ..Counters::default() }
    }
}

impl Samples {
    /// The next message as it is, in its own unit.
    fn next(&mut self) -> Result<Option<ImuSample>, FormatError> {
        let Some(message) = self.messages.next_message()? else { return Ok(None) };
        let offset = message.offset;
        let imu = Imu::parse(message.data, self.topic.encoding);
        let bad = |cause: String| bad_message(&self.path, offset, &self.topic.name, &cause);
        let imu = imu.map_err(|cause| bad(cause.to_string()))?;
        let Imu { header, gyro, accel } = imu;
        Ok(Some(ImuSample { stamp_ns: header.stamp_ns, gyro, accel, ..ImuSample::default() }))
    }
}

/// rad/s of one unit of the messages, by how gravity turns, whose length is `one_g` in their unit. Other scales that are wrong are
/// said and left as they are: which is right only the sensor's maker knows.
fn gyro_unit_of(mut samples: Samples, one_g: f64) -> Result<f64, StageError> {
    let mut check = GyroScaleCheck::new(one_g);
    for _ in 0..SCALE_SAMPLES {
        let Some(ImuSample { stamp_ns, gyro, accel, .. }) = samples.next().map_err(file)? else { break };
        if gyro.iter().chain(&accel).all(|value| value.is_finite()) {
            check.push(stamp_ns, gyro, accel);
        }
    }
    let (path, topic) = (samples.path.display(), &samples.topic.name);
    match check.verdict() {
        GyroScale::Times(times) if times > 50.0 => {
            tracing::warn!(
                "{path}: gravity turns by a {times:.0}th of what {topic} says, so its rates are degrees/s; gyro_unit = \
                 \"rad/s\" takes them as they are"
            );
            return Ok(1_f64.to_radians());
        }
        GyroScale::Times(times) => tracing::warn!(
            "{path}: the rates on {topic} are {times:.2} times what gravity turns by; check the range that the driver of \
             the IMU assumes"
        ),
        GyroScale::Unlike => tracing::warn!(
            "{path}: gravity turns as no scale of the rates on {topic} says; check that both are in the same axes"
        ),
        GyroScale::Right | GyroScale::Unknown => {}
    }
    Ok(1.0)
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return f64::NAN;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// m/s^2 of one unit in which gravity has the length `norm`, and the unit's name.
fn unit_of(norm: f64, one_g: f64) -> Option<(f64, &'static str)> {
    if (0.5..2.0).contains(&norm) {
        Some((one_g, "g"))
    } else if (5.0..20.0).contains(&norm) {
        Some((1.0, "m/s^2"))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_tells_the_unit() {
        assert_eq!(unit_of(0.9937, 9.80665), Some((9.80665, "g")));
        assert_eq!(unit_of(9.78, 9.80665), Some((1.0, "m/s^2")));
        assert_eq!(unit_of(0.0, 9.80665), None);
        assert_eq!(unit_of(median(&mut []), 9.80665), None);
        assert_eq!(unit_of(981.0, 9.80665), None);
    }
}
