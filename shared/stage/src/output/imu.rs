//! IMU samples and attitudes.

use evac_frames::{ImuAttitude, ImuSample};
use evac_ports::services::{Attitude, Imu};
use evac_ports::{Bus, PortError, RecordPublisher, now_ns};

use super::{StageOutput, failed};
use crate::StageError;

/// Where a device's IMU samples go.
#[derive(Debug, Default)]
pub struct ImuOutput {
    /// What was published, newest last, where no shared memory is connected.
    pub memory: Vec<ImuSample>,
    /// Attitudes published, where no shared memory is connected.
    pub attitudes: Vec<ImuAttitude>,
    newest_only: bool,
    next_seq: u64,
    port: Option<ImuPort>,
}

#[derive(Debug)]
struct ImuPort {
    samples: RecordPublisher<Imu>,
    /// `None` for an IMU that has none.
    attitudes: Option<RecordPublisher<Attitude>>,
    epoch: u32,
}

impl ImuOutput {
    /// Keeps only the newest sample and attitude in memory, so that publishing does not allocate.
    pub fn newest_only() -> Self {
        let (memory, attitudes) = (Vec::with_capacity(1), Vec::with_capacity(1));
        Self { newest_only: true, memory, attitudes, ..Self::default() }
    }

    /// Opens the service of samples, for an IMU that knows no attitude.
    pub(crate) fn samples_only(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        let port = ImuPort { samples: RecordPublisher::open(bus)?, attitudes: None, epoch };
        Ok(Self { port: Some(port), ..Self::default() })
    }

    /// Publishes a sample; gives it with its number and the moment of its hand-over.
    ///
    /// # Errors
    /// [`StageError::Output`] when shared memory cannot be loaned or sent.
    pub fn publish(&mut self, sample: &ImuSample) -> Result<ImuSample, StageError> {
        let mut sample = ImuSample { seq: self.next_seq, sent_ns: now_ns(), ..*sample };
        self.next_seq += 1;
        match &self.port {
            Some(port) => {
                sample.epoch = port.epoch;
                port.samples.publish(&sample).map_err(failed)?;
            }
            None => {
                if self.newest_only {
                    self.memory.clear();
                }
                self.memory.push(sample);
            }
        }
        Ok(sample)
    }

    /// Publishes what the IMU itself makes of the newest sample.
    ///
    /// # Errors
    /// As [`Self::publish`].
    pub fn publish_attitude(&mut self, attitude: &ImuAttitude) -> Result<(), StageError> {
        let seq = self.next_seq.saturating_sub(1);
        let attitude = ImuAttitude { seq, sent_ns: now_ns(), ..*attitude };
        let Some(port) = &self.port else {
            if self.newest_only {
                self.attitudes.clear();
            }
            self.attitudes.push(attitude);
            return Ok(());
        };
        let attitude = ImuAttitude { epoch: port.epoch, ..attitude };
        port.attitudes.as_ref().map_or(Ok(()), |attitudes| attitudes.publish(&attitude)).map_err(failed)
    }
}

impl StageOutput for ImuOutput {
    const SERVICES: &'static [&'static str] = &["imu/sample", "imu/attitude"];
    const IS_SINK: bool = false;

    fn open(bus: &Bus, epoch: u32) -> Result<Self, PortError> {
        let attitudes = Some(RecordPublisher::open(bus)?);
        let port = ImuPort { samples: RecordPublisher::open(bus)?, attitudes, epoch };
        Ok(Self { port: Some(port), ..Self::default() })
    }

    fn count_from(&mut self, seq: u64) {
        self.next_seq = seq;
    }

    fn greet(&self) -> Result<(), PortError> {
        self.port.as_ref().map_or(Ok(()), |port| port.samples.greet())
    }
}
