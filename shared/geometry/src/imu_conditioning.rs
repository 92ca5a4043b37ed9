//! What is wrong with IMU readings before anyone integrates them: accelerations in g, and single samples that were
//! garbled on the way.

use evac_frames::ImuSample;
use nalgebra::Vector3;

use crate::STANDARD_GRAVITY;

/// Samples that decide about the unit of the acceleration: one second at 200 Hz.
const DECIDING_SAMPLES: u32 = 200;
/// Mean norm of the specific force below which it is in g, m/s^2: nothing that is carried falls freely for a second.
const G_BELOW: f64 = 3.0;
/// Change from one sample to the next that no carried rig makes, rad/s: 1000 rad/s^2 at 200 Hz.
const GYRO_JUMP: f64 = 5.0;
/// As above, m/s^2: footfalls reach about 20.
const ACCEL_JUMP: f64 = 60.0;
/// Over a longer interval a jump may be a motion.
const MAX_INTERVAL_NS: i64 = 25_000_000;

/// Takes a stream of samples to SI units and takes single spikes out of it. No allocation, constant time.
///
/// Livox devices and several ROS drivers report accelerations in g; taken for m/s^2 they would let every odometry fall
/// out of the building. A serial line garbles a word now and then: one sample of 1600 degrees/s turns everything by 8 degrees.
#[derive(Debug, Clone, Default)]
pub struct ImuConditioner {
    samples: u32,
    mean_force: f64,
    /// The last sample as it was handed out.
    last: Option<ImuSample>,
    /// The last sample as it came, where it was taken for a spike.
    doubted: Option<ImuSample>,
    spikes: u64,
}

/// One sample, and what it says about the one before.
#[derive(Debug, Clone, Copy)]
pub struct Conditioned {
    /// The sample. A jump that nothing has confirmed yet holds the values of the sample before.
    pub sample: ImuSample,
    /// The sample before, where it has to be corrected: confirmed as a motion, or as a spike and interpolated.
    pub previous: Option<ImuSample>,
}

impl ImuConditioner {
    /// Conditions the next sample; samples come in the order of time and have finite values.
    pub fn push(&mut self, raw: &ImuSample) -> Conditioned {
        let sample = self.in_si_units(raw);
        let Some(last) = self.last else {
            self.last = Some(sample);
            return Conditioned { sample, previous: None };
        };
        let mut previous = None;
        let mut before = last;
        if let Some(doubted) = self.doubted.take() {
            before = if jumps(&doubted, &sample) {
                self.spikes += 1;
                halfway(&last, &sample, doubted.stamp_ns)
            } else {
                doubted
            };
            previous = Some(before);
        }
        let held = if jumps(&before, &sample) {
            self.doubted = Some(sample);
            ImuSample { gyro: before.gyro, accel: before.accel, ..sample }
        } else {
            sample
        };
        self.last = Some(held);
        Conditioned { sample: held, previous }
    }

    /// Whether accelerations come in g and are converted.
    pub fn is_in_g(&self) -> bool {
        self.samples > 0 && self.mean_force < G_BELOW
    }

    /// Spikes taken out so far.
    pub fn spikes(&self) -> u64 {
        self.spikes
    }

    fn in_si_units(&mut self, raw: &ImuSample) -> ImuSample {
        if self.samples < DECIDING_SAMPLES {
            self.samples += 1;
            self.mean_force += (Vector3::from(raw.accel).norm() - self.mean_force) / f64::from(self.samples);
        }
        let scale = if self.is_in_g() { STANDARD_GRAVITY } else { 1.0 };
        ImuSample { accel: raw.accel.map(|value| value * scale), ..*raw }
    }
}

fn jumps(a: &ImuSample, b: &ImuSample) -> bool {
    let change = |a: [f64; 3], b: [f64; 3]| (Vector3::from(b) - Vector3::from(a)).norm();
    b.stamp_ns - a.stamp_ns <= MAX_INTERVAL_NS
        && (change(a.gyro, b.gyro) > GYRO_JUMP || change(a.accel, b.accel) > ACCEL_JUMP)
}

/// Values between two samples with the stamp of the one that was between them.
fn halfway(a: &ImuSample, b: &ImuSample, stamp_ns: i64) -> ImuSample {
    let middle = |a: [f64; 3], b: [f64; 3]| ((Vector3::from(a) + Vector3::from(b)) / 2.0).into();
    ImuSample { stamp_ns, gyro: middle(a.gyro, b.gyro), accel: middle(a.accel, b.accel), ..*a }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(k: i64, rate: f64, force: f64) -> ImuSample {
        ImuSample {
            stamp_ns: k * 5_000_000,
            gyro: [0.0, 0.0, rate],
            accel: [0.0, 0.0, force],
            ..ImuSample::default()
        }
    }

    fn conditioned(samples: &[ImuSample]) -> (Vec<ImuSample>, ImuConditioner) {
        let mut conditioner = ImuConditioner::default();
        let mut out: Vec<ImuSample> = Vec::new();
        for raw in samples {
            let next = conditioner.push(raw);
            if let (Some(last), Some(previous)) = (out.last_mut(), next.previous) {
                *last = previous;
            }
            out.push(next.sample);
        }
        (out, conditioner)
    }

    #[test]
    fn one_garbled_sample_is_replaced_by_its_neighbours() {
        let raw: Vec<_> =
            (0..20).map(|k| sample(k, if k == 10 { 27.9 } else { 0.1 * k as f64 }, 9.8)).collect();
        let (out, conditioner) = conditioned(&raw);
        assert_eq!(conditioner.spikes(), 1);
        assert_eq!(out[10].stamp_ns, raw[10].stamp_ns);
        for (k, sample) in out.iter().enumerate() {
            assert!((sample.gyro[2] - 0.1 * k as f64).abs() < 1e-12, "sample {k}: {:?}", sample.gyro);
        }
    }

    #[test]
    fn the_spike_is_held_back_before_anything_confirms_it() {
        let raw: Vec<_> = (0..11).map(|k| sample(k, if k == 10 { 27.9 } else { 0.5 }, 9.8)).collect();
        let (out, _) = conditioned(&raw);
        assert_eq!(out[10].gyro, [0.0, 0.0, 0.5]);
    }

    #[test]
    fn a_jump_that_stays_is_a_motion_and_passes() {
        let raw: Vec<_> = (0..20).map(|k| sample(k, if k >= 10 { 8.0 } else { 0.0 }, 9.8)).collect();
        let (out, conditioner) = conditioned(&raw);
        assert_eq!(conditioner.spikes(), 0);
        assert!(out.iter().zip(&raw).all(|(a, b)| a.gyro == b.gyro));
    }

    #[test]
    fn an_accelerometer_in_g_is_taken_to_metres_per_second_squared() {
        let raw: Vec<_> = (0..400).map(|k| sample(k, 0.0, 1.0 + 0.2 * (k as f64 * 0.3).sin())).collect();
        let (out, conditioner) = conditioned(&raw);
        assert!(conditioner.is_in_g());
        assert!(
            out.iter().zip(&raw).all(|(a, b)| (a.accel[2] - b.accel[2] * STANDARD_GRAVITY).abs() < 1e-12)
        );
    }

    #[test]
    fn a_walk_in_metres_per_second_squared_stays_as_it_is() {
        let raw: Vec<_> = (0..400).map(|k| sample(k, 0.0, 9.8 + 4.0 * (k as f64 * 0.06).sin())).collect();
        let (out, conditioner) = conditioned(&raw);
        assert!(!conditioner.is_in_g());
        assert_eq!(out, raw);
    }
}
