//! Writes a walk down as the real devices' own bytes: a network capture of the Mid-40, a log of the WT901C's serial
//! line, the truth as a TUM trajectory, and the rig.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::{Path, PathBuf};

use evac_formats::FormatError;
use evac_formats::livox_sdk1::{CartesianMm, DATAGRAM_SHOTS, encode_cartesian};
use evac_formats::pcap::PcapWriter;
use evac_formats::tum::{self, TumPose};
use evac_formats::wt901c::{encode_accel, encode_gyro};
use evac_frames::{Point, PoseFrame, ScanHeader};
use evac_stage::{Rig, StageError};
use serde::Serialize;

use crate::mid40::SHOT_NS;
use crate::walk::Sampled;

/// The capture's host clock at sensor time 0, nanoseconds since 1970; the devices' own stamps begin at 0.
const CAPTURE_START_NS: i64 = 1_700_000_000_000_000_000;
/// A Mid-40 and its host with the maker's factory addresses and the ports that its SDK takes.
const LIDAR: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(192, 168, 1, 11), 65_000);
const HOST: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(192, 168, 1, 50), 56_001);
/// Temperature word (25.00 degrees) and voltage word (5.00 V) of the IMU's frames.
const TEMPERATURE: i16 = 2500;
const VOLTAGE: i16 = 500;

/// The open files of a recording.
#[derive(Debug)]
pub(crate) struct Recording {
    folder: PathBuf,
    lidar: PcapWriter<BufWriter<File>>,
    imu: BufWriter<File>,
    truth: BufWriter<File>,
    shots: Vec<CartesianMm>,
    datagram: Vec<u8>,
}

impl Recording {
    const LIDAR: &'static str = "lidar.pcap";
    const IMU: &'static str = "wt901c.bin";
    const TRUTH: &'static str = "truth.tum";
    const RIG: &'static str = "rig.toml";

    /// Creates the folder where needed and starts the files, replacing older ones; the rig is written at once.
    pub(crate) fn create(folder: &Path, rig: &Rig) -> Result<Self, StageError> {
        fs::create_dir_all(folder).map_err(|cause| failed(folder, cause))?;
        let create = |name: &str| {
            let path = folder.join(name);
            File::create(&path).map(BufWriter::new).map_err(|cause| failed(&path, cause))
        };
        write_rig(&folder.join(Self::RIG), rig)?;
        let lidar = PcapWriter::new(create(Self::LIDAR)?);
        Ok(Self {
            lidar: lidar.map_err(|cause| failed(&folder.join(Self::LIDAR), cause))?,
            imu: create(Self::IMU)?,
            truth: create(Self::TRUTH)?,
            shots: Vec::with_capacity(DATAGRAM_SHOTS),
            datagram: Vec::new(),
            folder: folder.to_owned(),
        })
    }

    /// Frames 0x51 and 0x52, as the device sends them for each sample.
    pub(crate) fn imu(&mut self, sampled: &Sampled) -> Result<(), StageError> {
        let written = self
            .imu
            .write_all(&encode_accel(sampled.accel, TEMPERATURE))
            .and_then(|()| self.imu.write_all(&encode_gyro(sampled.gyro, VOLTAGE)));
        written.map_err(|cause| failed(&self.folder.join(Self::IMU), cause))
    }

    /// A datagram a millisecond, captured when its last shot was measured, and the true pose at the scan's end.
    pub(crate) fn scan(
        &mut self,
        header: &ScanHeader,
        points: &[Point],
        truth: &PoseFrame,
    ) -> Result<(), StageError> {
        self.datagrams(header, points).map_err(|cause| failed(&self.folder.join(Self::LIDAR), cause))?;
        let pose = TumPose {
            stamp_ns: header.frame.end_ns,
            position: truth.position,
            orientation: truth.orientation,
        };
        let written = tum::write_to(&mut self.truth, [&pose]);
        written.map_err(|cause| failed(&self.folder.join(Self::TRUTH), cause))
    }

    /// Hands everything to the operating system, so that a full disk is noticed.
    pub(crate) fn finish(mut self) -> Result<(), StageError> {
        self.imu.flush().map_err(|cause| failed(&self.folder.join(Self::IMU), cause))?;
        self.truth.flush().map_err(|cause| failed(&self.folder.join(Self::TRUTH), cause))?;
        self.lidar.finish().map_err(|cause| failed(&self.folder.join(Self::LIDAR), cause))?;
        Ok(())
    }

    fn datagrams(&mut self, header: &ScanHeader, points: &[Point]) -> io::Result<()> {
        for (packet, points) in points.chunks(DATAGRAM_SHOTS).enumerate() {
            let stamp_ns = header.frame.start_ns + (packet * DATAGRAM_SHOTS) as i64 * SHOT_NS;
            self.shots.clear();
            self.shots.extend(points.iter().map(shot));
            encode_cartesian(stamp_ns as u64, &self.shots, &mut self.datagram);
            let captured_ns = CAPTURE_START_NS + stamp_ns + points.len() as i64 * SHOT_NS;
            self.lidar.write_udp(captured_ns, LIDAR, HOST, &self.datagram)?;
        }
        Ok(())
    }
}

fn shot(point: &Point) -> CartesianMm {
    // Points are whole millimetres already; rounding undoes their way through binary metres.
    let position = [point.x, point.y, point.z].map(|metres| (f64::from(metres) * 1e3).round() as i32);
    CartesianMm { position, reflectivity: point.reflectivity() }
}

fn write_rig(path: &Path, rig: &Rig) -> Result<(), StageError> {
    #[derive(Serialize)]
    struct RigFile<'a> {
        rig: &'a Rig,
    }
    let text = toml::to_string(&RigFile { rig }).map_err(|cause| StageError::Config(cause.to_string()))?;
    fs::write(path, text).map_err(|cause| failed(path, cause))
}

fn failed(path: &Path, cause: io::Error) -> StageError {
    StageError::File(FormatError::writing(path, cause).to_string())
}

#[cfg(test)]
mod tests;
