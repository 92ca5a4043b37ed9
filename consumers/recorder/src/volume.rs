//! One file of a recording, readable without the others.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use evac_formats::mcap::McapWriter;
use evac_formats::ros::schemas::{OCTETS, Schema};

use crate::channels::{Service, TRANSFORMS, raw_topic, ros_topic};
use crate::disk::{self, Disk, DiskWriter};
use crate::{RecorderConfig, RecorderError};

/// A file as it lies beside the recording: name, type of its text, text.
#[derive(Debug, Clone)]
pub(crate) struct Document {
    pub(crate) name: &'static str,
    pub(crate) media_type: &'static str,
    pub(crate) text: String,
}

/// A file that is written.
pub(crate) struct Volume {
    writer: McapWriter<DiskWriter>,
    channels: Vec<ServiceChannels>,
    transforms: Option<Channel>,
    /// Bytes handed to the disk, and in the chunk that is being filled.
    pub(crate) written: u64,
    filled: u64,
    chunk_bytes: u64,
    chunk_ns: i64,
    /// Sensor time of the first message, and of the first in the chunk.
    pub(crate) first_ns: Option<i64>,
    chunk_start_ns: Option<i64>,
}

/// Where one service's messages go; none where it is not recorded in that form.
#[derive(Debug, Default)]
pub(crate) struct ServiceChannels {
    pub(crate) ros: Option<Channel>,
    pub(crate) raw: Option<Channel>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Channel {
    id: u16,
    sequence: u32,
}

/// A form of a service's messages.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Form {
    Ros,
    Raw,
    Transform,
}

impl Volume {
    /// Creates a file, with all its channels and the documents as attachments.
    pub(crate) fn create(
        path: &Path,
        config: &RecorderConfig,
        documents: &[Document],
    ) -> Result<(Self, Disk), RecorderError> {
        let (to_disk, disk) = disk::create(path, config.queue_chunks as usize)?;
        let library = concat!("evac ", env!("CARGO_PKG_VERSION"));
        let mut writer = McapWriter::new(to_disk, "ros2", library, config.compression.into())?;
        for Document { name, media_type, text } in documents {
            writer.attach(name, media_type, text.as_bytes())?;
        }
        let (channels, transforms) = add_channels(&mut writer, config)?;
        let volume = Self {
            written: writer.end_chunk()?,
            writer,
            channels,
            transforms,
            filled: 0,
            chunk_bytes: u64::from(config.chunk_mib) << 20,
            chunk_ns: (config.chunk_s * 1e9) as i64,
            first_ns: None,
            chunk_start_ns: None,
        };
        Ok((volume, disk))
    }

    pub(crate) fn has(&self, service: Service, form: Form) -> bool {
        let channels = self.channels.get(service as usize);
        match form {
            Form::Ros => channels.is_some_and(|channels| channels.ros.is_some()),
            Form::Raw => channels.is_some_and(|channels| channels.raw.is_some()),
            Form::Transform => self.transforms.is_some(),
        }
    }

    /// Appends a message of a channel that the file has; whether a chunk went to the disk with it.
    pub(crate) fn write(
        &mut self,
        service: Service,
        form: Form,
        time_ns: i64,
        message: &[u8],
    ) -> Result<bool, RecorderError> {
        let channels = self.channels.get_mut(service as usize);
        let channel = match form {
            Form::Ros => channels.and_then(|channels| channels.ros.as_mut()),
            Form::Raw => channels.and_then(|channels| channels.raw.as_mut()),
            Form::Transform => self.transforms.as_mut(),
        };
        let Some(channel) = channel else { return Ok(false) };
        // MCAP knows no times before 1970.
        let log_time = u64::try_from(time_ns).unwrap_or_default();
        self.writer.write(channel.id, channel.sequence, log_time, message);
        channel.sequence = channel.sequence.wrapping_add(1);
        self.filled += message.len() as u64;
        self.first_ns.get_or_insert(time_ns);
        let start_ns = *self.chunk_start_ns.get_or_insert(time_ns);
        let full = self.filled >= self.chunk_bytes || time_ns.saturating_sub(start_ns) >= self.chunk_ns;
        if full {
            self.written = self.writer.end_chunk()?;
            (self.filled, self.chunk_start_ns) = (0, None);
        }
        Ok(full)
    }

    /// Writes the index; what is left is on its way to the disk.
    pub(crate) fn finish(self) -> Result<(), RecorderError> {
        self.writer.finish()?;
        Ok(())
    }
}

fn add_channels(
    writer: &mut McapWriter<DiskWriter>,
    config: &RecorderConfig,
) -> io::Result<(Vec<ServiceChannels>, Option<Channel>)> {
    let mut schemas = BTreeMap::new();
    let mut add = |topic: &str, schema: &Schema, metadata: &BTreeMap<String, String>| {
        let known = schemas.get(schema.name).copied();
        let schema_id = match known {
            Some(id) => id,
            None => writer.add_schema(schema.name, "ros2msg", schema.text.as_bytes())?,
        };
        schemas.insert(schema.name, schema_id);
        let id = writer.add_channel(schema_id, topic, "cdr", metadata)?;
        Ok::<_, io::Error>(Channel { id, sequence: 0 })
    };
    let mut channels = Vec::new();
    let mut transforms = None;
    for service in Service::ALL {
        let mut own = ServiceChannels::default();
        if config.services.iter().any(|name| name == service.name()) {
            if let Some((topic, schema)) = ros_topic(service).filter(|_| config.ros) {
                own.ros = Some(add(topic, &schema, &BTreeMap::new())?);
            }
            if config.ros && service == Service::Pose {
                let (topic, schema) = TRANSFORMS;
                transforms = Some(add(topic, &schema, &BTreeMap::new())?);
            }
            if config.raw {
                let (topic, metadata) = raw_topic(service);
                own.raw = Some(add(&topic, &OCTETS, &metadata)?);
            }
        }
        channels.push(own);
    }
    Ok((channels, transforms))
}
