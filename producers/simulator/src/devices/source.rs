//! A walk measured by devices: the drivers get it over the network and a serial line, and only its truth is published here.

use std::collections::VecDeque;
use std::time::Duration;

use evac_frames::{FrameHeader, Point, PoseFrame};
use evac_stage::{Device, Reporter, Rig, StageConfig as _, StageError, TruthOutput};

use super::Fault;
use super::config::DevicesConfig;
use super::fault::Wrong;
use super::imu_thread::ImuThread;
use super::livox::{LivoxDevice, WalkFeed, WalkScene};
use super::now_ns;
use crate::mid40::SHOTS_PER_FRAME;
use crate::walk::Walk;

/// Scans that are simulated ahead of time.
const AHEAD: usize = 8;
/// Pause where nothing is to be done.
const NAP: Duration = Duration::from_millis(5);

/// A simulated LiDAR and IMU; publishes `truth/pose` on the host's monotonic clock.
#[derive(Debug)]
pub struct DeviceSimulator {
    walk: Walk,
    lidar: std::sync::Arc<LivoxDevice>,
    /// The WT901C, unless the LiDAR has an IMU of its own.
    imu: Option<ImuThread>,
    faults: Vec<Fault>,
    feed: WalkFeed,
    /// The scan that is put in as soon as there is room.
    scan: Option<(u64, Vec<Point>)>,
    truth: VecDeque<PoseFrame>,
    next_seq: u64,
}

impl Device for DeviceSimulator {
    const NAME: &'static str = "device_simulator";
    type Config = DevicesConfig;
    type Output = TruthOutput;

    fn new(config: DevicesConfig, rig: &Rig) -> Result<Self, StageError> {
        config.check().map_err(StageError::Config)?;
        // Only a WT901C zeroes its gyroscope at rest.
        let auto_zero = config.walk.auto_zero && !config.lidar.imu;
        let walk = Walk::new(&crate::Config { auto_zero, ..config.walk }, rig)?;
        let (feed, scene) = WalkScene::new(AHEAD, walk.clone());
        let lidar = LivoxDevice::start(config.lidar.clone(), Box::new(scene)).map_err(|cause| {
            StageError::File(format!(
                "the simulated LiDAR: {cause}; end what uses that address, or set lidar.address"
            ))
        })?;
        let lidar = std::sync::Arc::new(lidar);
        let clock = std::sync::Arc::clone(&lidar);
        let plug_in = || {
            let (port, ppm) = (&config.imu_port, config.imu_clock_ppm);
            ImuThread::start(port, ppm, walk.clone(), move || clock.began_ns()).map_err(|cause| {
                let port = port.display();
                StageError::File(format!("the simulated WT901C at {port}: {cause}; set imu_port to a path in a folder that you may write to"))
            })
        };
        let imu = (!config.lidar.imu).then(plug_in).transpose()?;
        Ok(Self {
            walk,
            lidar,
            imu,
            faults: config.faults,
            feed,
            scan: None,
            truth: VecDeque::with_capacity(2 * AHEAD),
            next_seq: 0,
        })
    }

    fn serve(
        &mut self,
        output: &mut TruthOutput,
        reporter: &mut Reporter,
        patience: Duration,
    ) -> Result<(), StageError> {
        reporter.expect(Some(self.walk.frames()));
        self.publish(output, reporter)?;
        if self.scan.is_none() {
            let mut points = Vec::with_capacity(SHOTS_PER_FRAME);
            if let Some((header, truth)) = self.walk.next_scan(&mut points) {
                self.truth.push_back(truth);
                self.scan = Some((header.frame.seq, points));
            }
        }
        match self.scan.take().map(|scan| self.feed.put(scan)) {
            Some(Ok(())) => return Ok(()),
            Some(Err(scan)) => self.scan = Some(scan),
            None => {}
        }
        std::thread::sleep(patience.min(NAP));
        Ok(())
    }
}

impl DeviceSimulator {
    /// Publishes the true poses whose time has come.
    fn publish(&mut self, output: &mut TruthOutput, reporter: &mut Reporter) -> Result<(), StageError> {
        let Some(began_ns) = self.lidar.began_ns() else {
            reporter.note("waiting until the LiDAR is told to measure");
            return Ok(());
        };
        let now = now_ns();
        let time_s = (now - began_ns) as f64 * 1e-9;
        self.go_wrong(began_ns, time_s);
        while self.truth.front().is_some_and(|truth| began_ns + truth.frame.end_ns <= now) {
            let Some(mut truth) = self.truth.pop_front() else { break };
            truth.frame = FrameHeader {
                seq: self.next_seq,
                start_ns: began_ns + truth.frame.start_ns,
                end_ns: began_ns + truth.frame.end_ns,
                arrival_ns: now,
                ..truth.frame
            };
            self.next_seq += 1;
            reporter.begin();
            output.publish(&truth)?;
            reporter.done(&truth.frame, now);
        }
        let late = self.feed.late();
        if late > 0 {
            reporter.counters.degraded = late;
            reporter.note(&format!("{late} scans were not simulated in time: the machine is too busy"));
        } else {
            let on: Vec<_> =
                self.faults.iter().filter(|fault| fault.is_on(time_s)).map(Fault::to_string).collect();
            reporter.note(&on.join(", "));
        }
        Ok(())
    }

    /// Makes everything as wrong as it should be by now.
    fn go_wrong(&self, began_ns: i64, time_s: f64) {
        if self.faults.is_empty() {
            return;
        }
        let wrong = Wrong::at(&self.faults, time_s);
        self.lidar.faults(|faults| *faults = wrong.lidar);
        if let Some(until_s) = wrong.lidar_off_until_s {
            self.lidar.power_off_until(began_ns + (until_s * 1e9) as i64);
        }
        if let Some(imu) = &self.imu {
            imu.set_faults(wrong.imu);
        }
    }
}
