//! Maps from OctoMap's files.

use std::ops::ControlFlow;
use std::path::Path;

use evac_formats::octomap::Reader;

use crate::build::Builder;
use crate::{MapConfig, MapError, OctreeMap, ReadError};

impl OctreeMap {
    /// A map from the bytes of a `.ot` or `.bt` file, without a tree between; `name` is only for messages. The file's
    /// resolution takes the place of that in `config`; the voxels of a `.bt` get the clamps of its sensor model.
    ///
    /// ```
    /// use std::path::Path;
    /// use evac_octree::{MapConfig, OctreeMap};
    ///
    /// let mut map = OctreeMap::new(MapConfig::new(0.1))?;
    /// map.update_node([1.0, 2.0, 0.5], true)?;
    /// let read = OctreeMap::read(&map.ot_bytes(), Path::new("map.ot"), MapConfig::new(0.1))?;
    /// assert!(read.voxels().eq(map.voxels()));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`ReadError::File`] where the bytes are no such file, [`ReadError::Map`] where the map would be too large.
    pub fn read(bytes: &[u8], name: &Path, config: MapConfig) -> Result<Self, ReadError> {
        let reader = Reader::new(bytes, name)?;
        let in_file = |cause: MapError| ReadError::Map { path: name.to_owned(), cause };
        let map = Self::new(MapConfig { resolution: reader.resolution(), ..config }).map_err(in_file)?;
        let mut builder = Builder::new(map);
        let mut refusal = None;
        reader.for_each_leaf(&config.sensor.binary_values(), |leaf| {
            match builder.leaf(leaf.code, leaf.depth.into(), leaf.log_odds) {
                Ok(()) => ControlFlow::Continue(()),
                Err(cause) => {
                    refusal = Some(cause);
                    ControlFlow::Break(())
                }
            }
        })?;
        match refusal {
            Some(cause) => Err(in_file(cause)),
            None => builder.finish().map_err(in_file),
        }
    }
}
