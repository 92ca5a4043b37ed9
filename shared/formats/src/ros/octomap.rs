//! `octomap_msgs/Octomap`.

use super::wire::{Encoding, Header, MessageError, Wire};
use super::writer::{Stamp, Writer};
use crate::octomap::OctomapBody;

/// The only kind of tree that is written.
const ID: &str = "OcTree";

/// A map as ROS's octomap packages exchange it.
#[derive(Debug, Clone, Copy)]
pub struct Octomap<'a> {
    /// Time and frame of the map.
    pub header: Header<'a>,
    /// Two bits a child, else log-odds.
    pub binary: bool,
    /// Kind of tree, `OcTree` unless voxels have colours or stamps.
    pub id: &'a [u8],
    /// Edge of a voxel, metres.
    pub resolution: f64,
    /// The tree without the text that files have in front of it.
    pub data: &'a [u8],
}

impl<'a> Octomap<'a> {
    /// The message type with this layout.
    pub const TYPE: &'static str = "octomap_msgs/Octomap";

    /// Reads a serialised message.
    ///
    /// # Errors
    /// [`MessageError::Truncated`] and, for CDR, [`MessageError::Encapsulation`].
    pub fn parse(bytes: &'a [u8], encoding: Encoding) -> Result<Self, MessageError> {
        let mut wire = Wire::new(bytes, encoding)?;
        Ok(Self {
            header: wire.header()?,
            binary: wire.u8()? != 0,
            id: wire.string()?,
            resolution: f64::from_bits(wire.u64()?),
            data: wire.counted_bytes()?,
        })
    }

    /// The tree's bytes, where they are a plain octree's.
    pub fn body(&self) -> Option<OctomapBody> {
        let Self { binary, resolution, data, .. } = *self;
        (self.id == ID.as_bytes()).then(|| OctomapBody { binary, resolution, data: data.to_vec() })
    }
}

/// Appends a serialised message to `out`.
pub fn write_octomap(out: &mut Vec<u8>, encoding: Encoding, header: &Stamp<'_>, map: &OctomapBody) {
    let mut writer = Writer::new(out, encoding);
    writer.header(header);
    writer.u8(u8::from(map.binary));
    writer.string(ID);
    writer.u64(map.resolution.to_bits());
    writer.u32(map.data.len() as u32);
    writer.raw(&map.data);
}
