//! From frames to IMU samples, and from raw words to SI units.

use super::frame::{FRAME_BYTES, Frame, id};

/// Specific force and angular velocity of one instant, as raw words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawSample {
    /// Specific force; see [`Scales`].
    pub accel: [i16; 3],
    /// Angular velocity; see [`Scales`].
    pub gyro: [i16; 3],
    /// Time on the module's clock where its group has a valid frame 0x50, nanoseconds since 1970 (any date).
    pub time_ns: Option<i64>,
    /// Where its accelerometer frame begins in the stream.
    pub offset: u64,
}

/// Puts the frames of one instant together: the module sends them back to back in the order of their ids. A sample of
/// which one frame is missing is dropped whole and counted.
#[derive(Debug, Clone, Default)]
pub struct Assembler {
    time: Option<(u64, Option<i64>)>,
    accel: Option<Frame>,
    incomplete: u64,
}

impl Assembler {
    /// Takes in the next frame; a sample when this frame completes one.
    pub fn push(&mut self, frame: &Frame) -> Option<RawSample> {
        match frame.id {
            id::TIME => {
                self.abandon();
                self.time = Some((frame.offset, frame.time_ns()));
                None
            }
            id::ACCEL => {
                self.abandon();
                self.accel = Some(*frame);
                None
            }
            id::GYRO => self.complete(frame),
            _ => None,
        }
    }

    /// Samples dropped because a frame was missing.
    pub fn incomplete(&self) -> u64 {
        self.incomplete
    }

    /// Whether an accelerometer frame still waits for its gyroscope frame.
    pub fn pending(&self) -> bool {
        self.accel.is_some()
    }

    fn abandon(&mut self) {
        self.incomplete += u64::from(self.accel.take().is_some());
    }

    fn complete(&mut self, gyro: &Frame) -> Option<RawSample> {
        let time = self.time.take();
        let accel = self.accel.take().filter(|accel| follows(accel.offset, gyro.offset));
        let Some(accel) = accel else {
            self.incomplete += 1;
            return None;
        };
        let time_ns = time.filter(|(offset, _)| follows(*offset, accel.offset)).and_then(|(_, time)| time);
        Some(RawSample { accel: accel.triple(), gyro: gyro.triple(), time_ns, offset: accel.offset })
    }
}

/// Whether no whole frame fits between two frames, so that they are neighbours in spite of inserted bytes.
fn follows(first: u64, second: u64) -> bool {
    second.saturating_sub(first) < 2 * FRAME_BYTES as u64
}

/// What one raw unit stands for.
///
/// The manual's ranges are +-16 g and +-2000 deg/s over 32768. It means g = 9.80665 m/s^2 where the vendor's sample
/// code multiplies by 9.8; the two differ by 0.07 %, less than the sensor's own scale error, and an estimator takes the
/// length of gravity from its standstill anyway.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    /// m/s^2.
    pub accel: f64,
    /// rad/s.
    pub gyro: f64,
}

impl Default for Scales {
    fn default() -> Self {
        Self::with_gravity(9.80665)
    }
}

impl Scales {
    /// The manual's ranges with another value of one g in m/s^2.
    pub fn with_gravity(g: f64) -> Self {
        Self { accel: 16.0 * g / 32768.0, gyro: 2000_f64.to_radians() / 32768.0 }
    }

    /// Specific force in m/s^2.
    pub fn accel(&self, raw: [i16; 3]) -> [f64; 3] {
        raw.map(|word| f64::from(word) * self.accel)
    }

    /// Angular velocity in rad/s.
    pub fn gyro(&self, raw: [i16; 3]) -> [f64; 3] {
        raw.map(|word| f64::from(word) * self.gyro)
    }

    /// The raw words for a specific force in m/s^2, saturated as the sensor's are.
    pub fn quantise_accel(&self, accel: [f64; 3]) -> [i16; 3] {
        accel.map(|value| (value / self.accel).round() as i16)
    }

    /// The raw words for an angular velocity in rad/s, saturated as the sensor's are.
    pub fn quantise_gyro(&self, gyro: [f64; 3]) -> [i16; 3] {
        gyro.map(|value| (value / self.gyro).round() as i16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wt901c::{Parser, encode_accel, encode_gyro};

    fn samples(bytes: &[u8]) -> (Vec<RawSample>, u64) {
        let (mut parser, mut assembler) = (Parser::default(), Assembler::default());
        let samples = bytes.iter().filter_map(|byte| assembler.push(&parser.push(*byte)?)).collect();
        (samples, assembler.incomplete())
    }

    #[test]
    fn two_halves_of_different_instants_are_not_joined() {
        let mut bytes = encode_accel([1, 1, 1], 0).to_vec();
        bytes.extend([0; 22]); // the gyroscope frame and the next accelerometer frame were wiped out
        bytes.extend(encode_gyro([2, 2, 2], 0));
        assert_eq!(samples(&bytes), (vec![], 1));
    }

    #[test]
    fn one_g_and_one_turn_have_the_manual_s_values() {
        let scales = Scales::default();
        let [x, y, z] = scales.accel([2048, -4096, 16384]);
        assert!((x - 9.80665).abs() < 1e-12 && (y + 19.6133).abs() < 1e-12 && (z - 78.4532).abs() < 1e-12);
        let [x, ..] = scales.gyro([16384, 0, 0]);
        assert!((x - 1000_f64.to_radians()).abs() < 1e-12);
        assert_eq!(scales.quantise_accel([9.80665, -1e9, 1e9]), [2048, i16::MIN, i16::MAX]);
        assert_eq!(scales.quantise_gyro(scales.gyro([-32768, 32767, 5])), [-32768, 32767, 5]);
    }
}
