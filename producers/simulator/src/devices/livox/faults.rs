//! What can go wrong with a device and its cable.

use crate::random::Random;

/// Faults, which may be changed at any time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// Share of data packets that get lost.
    pub lost_share: f64,
    /// Share of data packets that come twice.
    pub repeated_share: f64,
    /// Share of data packets that the next three overtake.
    pub late_share: f64,
    /// Share of data packets with one byte changed, or cut to half. Without a checksum the first protocol cannot tell a changed
    /// reflectivity; a real network's own checksum does.
    pub corrupt_share: f64,
    /// Added to the device's clock, milliseconds.
    pub clock_step_ms: f64,
    /// What the device says of itself: status word of the first protocol, diagnostics of the second.
    pub status: u32,
    /// The cable is pulled: nothing comes and nothing goes.
    pub cable_out: bool,
    /// The device does not hear heartbeats and questions.
    pub deaf: bool,
}

/// Lays faults over data packets.
#[derive(Debug)]
pub(super) struct Faulty {
    random: Random,
    /// A packet that is being overtaken, and by how many more.
    late: Option<(Vec<u8>, u32)>,
}

impl Faulty {
    pub(super) fn new(seed: u64) -> Self {
        Self { random: Random::new(seed, 40), late: None }
    }

    /// Sends a packet as the faults want it; how often it was lost, 0 or 1.
    pub(super) fn send(&mut self, faults: &Faults, bytes: &mut Vec<u8>, mut send: impl FnMut(&[u8])) -> u64 {
        // The same draws for every packet, so that one fault does not move another.
        let [lost, repeated, late, corrupt, place] = [(); 5].map(|()| self.random.uniform());
        if lost < faults.lost_share {
            return 1;
        }
        if corrupt < faults.corrupt_share {
            // Version, data type, stamp and reflectivity, by the first protocol's layout.
            // (Of an IMU's packet the last digits of an acceleration.)
            match [0, 9, 17, 30].get((place * 8.0) as usize).and_then(|at| bytes.get_mut(*at)) {
                Some(byte) => *byte = byte.wrapping_add(77),
                None => bytes.truncate(bytes.len() / 2),
            }
        }
        if late < faults.late_share && self.late.is_none() {
            self.late = Some((bytes.clone(), 3));
            return 0;
        }
        send(bytes);
        if repeated < faults.repeated_share {
            send(bytes);
        }
        match &mut self.late {
            Some((held, 0)) => {
                send(held);
                self.late = None;
            }
            Some((_, left)) => *left -= 1,
            None => {}
        }
        0
    }
}
