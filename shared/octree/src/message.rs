//! Maps as `octomap_msgs/Octomap` carries them.

use std::path::Path;

use evac_formats::octomap::OctomapBody;

use crate::{MapConfig, MapError, OctreeMap, Pruning, ReadError};

impl OctreeMap {
    /// The body of `octomap_full`: log-odds, as `fullMapToMsg` makes it.
    pub fn full_message(&self) -> OctomapBody {
        OctomapBody::full(&self.to_tree(Pruning::Full))
    }

    /// The body of `octomap_binary`: free or occupied, as `binaryMapToMsg` makes it. See [`OctreeMap::bt_bytes`] for how far
    /// the tree is pruned.
    pub fn binary_message(&self) -> OctomapBody {
        // An empty map has no root, and a message of it no bytes.
        let data = if self.known() == 0 { Vec::new() } else { self.binary_body().0 };
        OctomapBody { binary: true, resolution: self.space().resolution(), data }
    }

    /// A map from a message's body; its resolution takes the place of that in `config`, and the voxels of a binary one get
    /// the clamps of the sensor model.
    ///
    /// ```
    /// use evac_octree::{MapConfig, OctreeMap};
    ///
    /// let mut map = OctreeMap::new(MapConfig::new(0.1))?;
    /// map.update_node([1.0, 2.0, 0.5], true)?;
    /// let received = OctreeMap::from_message(&map.full_message(), MapConfig::new(0.1))?;
    /// assert!(received.voxels().eq(map.voxels()));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`ReadError::File`] where the bytes are no octree, [`ReadError::Map`] where the map would be too large.
    pub fn from_message(body: &OctomapBody, config: MapConfig) -> Result<Self, ReadError> {
        let name = Path::new("octomap_msgs/Octomap");
        let tree = body.tree(name, &config.sensor.binary_values())?;
        Self::from_tree(&tree, config.sensor, config.max_bytes)
            .map_err(|cause: MapError| ReadError::Map { path: name.to_owned(), cause })
    }
}
