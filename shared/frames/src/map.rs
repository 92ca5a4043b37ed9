//! What the mapper and the grid exporter say.

use crate::layout::frame;
use crate::scan::FrameHeader;

/// Bits of [`MapHeader::map_flags`].
pub mod map_flags {
    /// The scan was a key frame and went into the map; otherwise the update is empty.
    pub const KEY_FRAME: u32 = 1;
    /// The payload holds the whole map (on `map/snapshot`).
    pub const SNAPSHOT: u32 = 2;
}

/// Bits of [`Voxel::flags`]. A voxel without any has been forgotten: it is unknown again.
pub mod voxel_flags {
    /// A ground point was seen in this voxel.
    pub const GROUND: u16 = 1;
    /// The voxel carries a log-odds value; without it only the ground flag is known.
    pub const KNOWN: u16 = 2;
}

frame! {
    /// User header of `map/update` and `map/snapshot`; the payload is a slice of [`Voxel`].
    ///
    /// Every scan gives one update, an empty one where it was no key frame, so that consumers see gap-free `seq`.
    "evac.MapHeader.v2", 120 bytes,
    pub struct MapHeader {
        /// Sequence number and times of the scan; of the last scan in the map for a snapshot.
        pub frame: FrameHeader,
        /// Edge of a voxel, metres.
        pub resolution: f64,
        /// Position of the LiDAR in the map frame at this scan, metres.
        pub position: [f64; 3],
        /// Key frames in the map up to here, this one included.
        pub key_frames: u64,
        /// See [`map_flags`].
        pub map_flags: u32,
        /// Voxels in the payload.
        pub voxels: u32,
        /// Points of this scan that went into the map as hits.
        pub hits: u32,
        /// Points of this scan that were taken as ground.
        pub ground: u32,
        /// Points removed by the radius outlier filter.
        pub outliers: u32,
        /// Points removed by the conditional filter.
        pub outside: u32,
        /// Points rejected for another reason (not finite, beyond the key space).
        pub rejected: u32,
        /// Epoch of the mapper that began this map: one that takes over goes on with the map, one that starts anew begins
        /// another.
        pub map_epoch: u32,
    }
}

frame! {
    /// One voxel of the finest level with its new state.
    "evac.Voxel.v1", 12 bytes,
    pub struct Voxel {
        /// OctoMap key: floor(coordinate / resolution) + 32768 per axis.
        pub key: [u16; 3],
        /// See [`voxel_flags`].
        pub flags: u16,
        /// Log-odds of occupancy.
        pub log_odds: f32,
    }
}

frame! {
    /// User header of `grid/plan`; the payload is `width * height` cells (`i8`: -1 unknown, 0 free, 100 occupied),
    /// row-major with row 0 at the lowest y, as in `nav_msgs/OccupancyGrid`.
    "evac.GridHeader.v1", 88 bytes,
    pub struct GridHeader {
        /// Sequence number and times of the last scan in the plan.
        pub frame: FrameHeader,
        /// Edge of a cell, metres.
        pub resolution: f64,
        /// Lower-left corner of cell (0, 0) in the map frame, metres.
        pub origin: [f64; 2],
        /// Cells along x.
        pub width: u32,
        /// Cells along y.
        pub height: u32,
        /// Always zero.
        pub reserved: [u32; 2],
    }
}
