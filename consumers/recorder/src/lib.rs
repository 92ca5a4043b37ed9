//! Records everything that is said on the services to MCAP files, in two forms side by side: as ROS 2 messages, which
//! Foxglove, Lichtblick, Rerun, `ros2 bag` and Python read, and as the frames lie in shared memory, which the replay plays
//! back bit by bit.
//!
//! Messages go into a chunk in memory; a full chunk goes to a thread that writes and syncs it. A power cut or a kill loses at
//! most the chunk that is being filled and those that wait for the disk, normally none. A full disk ends the recording, not the
//! pipeline; what is on it is closed and can be read. After warm-up a frame costs no allocation; each chunk leaves an entry that is
//! kept until the file is closed.

mod channels;
mod config;
mod disk;
mod messages;
mod volume;

use std::io;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use evac_formats::{FormatError, utc_name};
use evac_frames::PoseFrame;
use evac_stage::{Counters, NoOutput, Rig, Stage, StageError, Tapped};
use rustix::fs::statvfs;

pub use config::{Compression, RecorderConfig};

use channels::Service;
use disk::{Disk, Refused};
use volume::{Document, Form, Volume};

/// Why a recording cannot go on.
#[derive(Debug)]
enum RecorderError {
    /// The file itself.
    File(FormatError),
    /// What the writer says of it, mostly that the disk thread has ended with an error of its own.
    Writer(io::Error),
    /// What the disk refused.
    Disk(Refused),
}

impl From<FormatError> for RecorderError {
    fn from(error: FormatError) -> Self {
        Self::File(error)
    }
}

impl From<io::Error> for RecorderError {
    fn from(error: io::Error) -> Self {
        Self::Writer(error)
    }
}

impl From<Refused> for RecorderError {
    fn from(refused: Refused) -> Self {
        Self::Disk(refused)
    }
}

/// The recorder as a [`Stage`].
pub struct Recorder {
    config: RecorderConfig,
    folder: PathBuf,
    documents: Vec<Document>,
    volume: Option<Volume>,
    /// Threads that still write: the open file's last.
    disks: Vec<Disk>,
    /// Number of the next file.
    next: u32,
    message: Vec<u8>,
    /// Time of the newest IMU sample.
    last_imu_ns: Option<i64>,
    /// For an operator, in health reports.
    note: String,
    /// Why nothing more is recorded; mapping goes on without it.
    failure: Option<StageError>,
}

impl Stage for Recorder {
    const NAME: &'static str = "recorder";
    type Config = RecorderConfig;
    type Input<'a> = Tapped<'a>;
    type Output = NoOutput;

    fn new(config: RecorderConfig, rig: &Rig) -> Result<Self, StageError> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let name = config.name.clone().unwrap_or_else(|| utc_name(now.cast_signed()));
        let folder = config.output_dir.join(name);
        let written = |cause| StageError::File(FormatError::writing(&folder, cause).to_string());
        std::fs::create_dir_all(&config.output_dir).map_err(written)?;
        std::fs::create_dir(&folder).map_err(|cause| match cause.kind() {
            std::io::ErrorKind::AlreadyExists => StageError::File(format!(
                "{}: there is a recording of that name; choose another with name, or move it away",
                folder.display()
            )),
            _ => written(cause),
        })?;
        let rig = toml::to_string(rig).map_err(|cause| StageError::Config(cause.to_string()))?;
        let documents = vec![
            Document {
                name: "rig.toml",
                media_type: "application/toml",
                text: format!("[rig]\n{}", nested(&rig)),
            },
            Document { name: "build.json", media_type: "application/json", text: build() },
        ];
        Ok(Self {
            config,
            folder,
            documents,
            volume: None,
            disks: Vec::new(),
            next: 0,
            message: Vec::new(),
            last_imu_ns: None,
            note: String::new(),
            failure: None,
        })
    }

    fn begin(&mut self, pipeline: &str) -> Result<(), StageError> {
        let text = pipeline.to_owned();
        self.documents.push(Document { name: "pipeline.toml", media_type: "application/toml", text });
        // At once: a folder that cannot be written to is said before anything starts.
        self.open().map_err(|error| self.explain(error))
    }

    fn process(
        &mut self,
        input: Tapped<'_>,
        _output: &mut NoOutput,
        counters: &mut Counters,
    ) -> Result<(), StageError> {
        if self.failure.is_none()
            && let Err(error) = self.record(&input)
        {
            let failure = self.explain(error);
            tracing::error!("nothing more is recorded, the pipeline goes on: {failure}");
            self.failure = Some(failure);
        }
        counters.degraded += u64::from(self.failure.is_some());
        Ok(())
    }

    fn finish(&mut self) -> Result<(), StageError> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        let closed = self.close();
        closed.map_err(|error| self.explain(error))?;
        // Of all, whatever one of them says.
        let waited = self.disks.drain(..).map(Disk::wait).fold(Ok(()), Result::and);
        waited.map_err(|refused| self.explain(refused.into()))
    }

    fn note(&self) -> &str {
        &self.note
    }
}

impl Recorder {
    fn record(&mut self, input: &Tapped<'_>) -> Result<(), RecorderError> {
        let (service, time_ns) = about(input);
        if self.is_full(time_ns) {
            self.close()?;
            self.reap()?;
            self.open()?;
        }
        let Self { volume: Some(volume), message, note, folder, next, last_imu_ns, .. } = self else {
            return Ok(());
        };
        // The word that no later sample comes repeats the last one, and is no measurement.
        let repeats = match input {
            Tapped::Imu(sample) => last_imu_ns.replace(sample.stamp_ns) == Some(sample.stamp_ns),
            _ => false,
        };
        let mut handed_over = false;
        for form in [Form::Raw, Form::Ros] {
            if volume.has(service, form) && !(repeats && matches!(form, Form::Ros)) {
                message.clear();
                match form {
                    Form::Raw => messages::write_raw(message, input),
                    _ => messages::write_ros(message, input),
                }
                handed_over |= volume.write(service, form, time_ns, message)?;
            }
        }
        if let Tapped::Pose(pose) = input
            && volume.has(service, Form::Transform)
        {
            message.clear();
            messages::write_tf(message, pose);
            handed_over |= volume.write(service, Form::Transform, time_ns, message)?;
        }
        if handed_over {
            say(note, folder, *next, volume.written);
            // A file that is closed already may still have been refused.
            self.reap()?;
        }
        Ok(())
    }

    fn is_full(&self, time_ns: i64) -> bool {
        let Some(volume) = &self.volume else { return false };
        let most = u64::from(self.config.max_file_mib) << 20;
        let longest = (self.config.max_file_s * 1e9) as i64;
        let length = volume.first_ns.map_or(0, |first| time_ns.saturating_sub(first));
        (most > 0 && volume.written >= most) || (longest > 0 && length >= longest)
    }

    /// Begins the next file.
    fn open(&mut self) -> Result<(), RecorderError> {
        let path = self.folder.join(format!("evac_{}.mcap", self.next));
        let (volume, disk) = Volume::create(&path, &self.config, &self.documents)?;
        tracing::info!("recording to {}", path.display());
        self.next += 1;
        self.volume = Some(volume);
        self.disks.push(disk);
        Ok(())
    }

    fn close(&mut self) -> Result<(), RecorderError> {
        self.volume.take().map_or(Ok(()), Volume::finish)
    }

    /// Lets go of files that are whole.
    fn reap(&mut self) -> Result<(), RecorderError> {
        while self.disks.first().is_some_and(Disk::has_ended) {
            self.disks.remove(0).wait()?;
        }
        Ok(())
    }

    /// The cause: where the disk refused, its own words instead of those that a thread is gone.
    fn explain(&mut self, error: RecorderError) -> StageError {
        self.volume = None;
        let refused = self.disks.drain(..).map(Disk::wait).fold(Ok(()), Result::and);
        let error = refused.err().map_or(error, RecorderError::Disk);
        let (short, long) = match error {
            RecorderError::File(error) => (error.to_string(), error.to_string()),
            RecorderError::Writer(error) => (
                error.to_string(),
                format!("{}: {error}; check the disk and try again", self.folder.display()),
            ),
            RecorderError::Disk(refused) => (refused.cause.to_string(), refused.explain()),
        };
        self.note = format!("recording has stopped: {short}");
        StageError::File(long)
    }
}

/// Says how large the newest file is and how much room is left; no allocation after the first time.
fn say(note: &mut String, folder: &Path, files: u32, written: u64) {
    use std::fmt::Write as _;
    note.clear();
    // A String takes everything.
    let _ = write!(note, "evac_{}.mcap: {:.0} MB", files.saturating_sub(1), written as f64 * 1e-6);
    if let Ok(disk) = statvfs(folder) {
        let free = disk.f_bavail.saturating_mul(disk.f_frsize);
        let _ = write!(note, ", {:.1} GB free", free as f64 * 1e-9);
    }
}

/// The service that a message is of, and the sensor time that it is filed under.
fn about(input: &Tapped<'_>) -> (Service, i64) {
    match input {
        Tapped::Scan(header, _) => (Service::Scan, header.frame.end_ns),
        Tapped::Imu(sample) => (Service::Imu, sample.stamp_ns),
        Tapped::Deskewed(header, _) => (Service::Deskewed, header.frame.end_ns),
        Tapped::Pose(PoseFrame { frame, .. }) => (Service::Pose, frame.end_ns),
        Tapped::Truth(PoseFrame { frame, .. }) => (Service::Truth, frame.end_ns),
        Tapped::Map(message) => (Service::Map, message.header.frame.end_ns),
        Tapped::Grid(header, _) => (Service::Grid, header.frame.end_ns),
        Tapped::Attitude(attitude) => (Service::Attitude, attitude.stamp_ns),
        Tapped::Health(_, now_ns) => (Service::Health, *now_ns),
        Tapped::Route(_, now_ns) => (Service::Route, *now_ns),
    }
}

/// Tables of a rig become tables of a rig file.
fn nested(rig: &str) -> String {
    rig.replace("[imu_from_lidar]", "[rig.imu_from_lidar]")
}

/// What wrote the file.
fn build() -> String {
    let (version, target) = (env!("CARGO_PKG_VERSION"), std::env::consts::ARCH);
    format!("{{\"program\": \"evac\", \"version\": \"{version}\", \"architecture\": \"{target}\"}}\n")
}
