//! What the map refuses.

use std::path::PathBuf;

use evac_formats::FormatError;

use crate::SensorModel;

/// Why a map cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MapError {
    /// The edge of a voxel is out of range.
    #[error("the resolution is {0} m; give the edge of a voxel between 0.0001 and 1000 m")]
    Resolution(f64),
    /// A probability or the order of two of them makes no sensor model.
    #[error(
        "{name} is {value}; probabilities lie between 0 and 1, miss and clamp_min below 0.5, hit and clamp_max above"
    )]
    Probability {
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A sensor model given in log-odds is no model.
    #[error(
        "{0:?} is no sensor model; give finite log-odds, miss and clamp_min below zero, hit and clamp_max above"
    )]
    Sensor(SensorModel),
    /// The ceiling leaves no room for a map.
    #[error("max_bytes is {max_bytes}; give at least 65536, and 320 bytes for each brick of 8x8x8 voxels")]
    Ceiling {
        /// The ceiling.
        max_bytes: usize,
    },
    /// The other map has voxels of another size.
    #[error("the maps have voxels of {ours} m and {theirs} m; only maps of one resolution can be merged")]
    OtherResolution {
        /// Edge of this map's voxels, metres.
        ours: f64,
        /// Edge of the other's.
        theirs: f64,
    },
    /// A tree needs more memory than the map may use.
    #[error(
        "the tree needs more than {max_bytes} bytes; raise max_bytes (320 for each brick of 8x8x8 voxels)"
    )]
    TooLarge {
        /// The ceiling.
        max_bytes: usize,
    },
}

/// Why a point or voxel did not go into the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Rejected {
    /// A coordinate or log-odds value is NaN or infinite.
    #[error("not a finite number")]
    NotFinite,
    /// Beyond the 65536 voxels a side that keys can name.
    #[error("beyond the key space of 65536 voxels a side")]
    OutsideKeySpace,
    /// A new brick would exceed the map's ceiling.
    #[error("the map takes as many bytes as it may")]
    Full,
}

/// Why a map was not read from a file.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The bytes are no OctoMap file.
    #[error(transparent)]
    File(#[from] FormatError),
    /// No map can be made of what they say.
    #[error("{}: {cause}", path.display())]
    Map {
        /// The file.
        path: PathBuf,
        /// What is in the way.
        cause: MapError,
    },
}
