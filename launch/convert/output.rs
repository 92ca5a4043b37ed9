//! What a map is written as, told by the name of the file.

use std::path::Path;

use evac_formats::cloud::{CloudPoint, Intensity};
use evac_formats::pcd::{self, WriteAs};
use evac_formats::{FormatError, occupancy_grid, octomap};
use evac_frames::{Voxel, voxel_flags};
use evac_octree::{OctreeMap, Pruning};

use super::flat_map::{self, FlatMap};
use super::usage;
use crate::error::LaunchError;

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Output {
    Binary,
    Full,
    Centres,
    Grid,
    Picture,
}

impl Output {
    pub(super) fn of(path: &Path) -> Result<Self, LaunchError> {
        Ok(match path.extension().and_then(|extension| extension.to_str()) {
            Some("bt") => Self::Binary,
            Some("ot") => Self::Full,
            Some("pcd") => Self::Centres,
            Some("pgm" | "yaml") => Self::Grid,
            Some("png") => Self::Picture,
            _ => {
                let name = path.display();
                return Err(usage(format!(
                    "{name}: the output's name must end in .bt (occupancy), .ot (log-odds), .pcd (voxel centres), \
                     .pgm, .yaml or .png (flat map)"
                )));
            }
        })
    }

    /// Whether it shows the ground.
    pub(super) fn is_flat(self) -> bool {
        matches!(self, Self::Grid | Self::Picture)
    }

    /// Writes the file whole or not at all.
    pub(super) fn write(
        self,
        path: &Path,
        map: &OctreeMap,
        flat: &FlatMap,
        write_as: WriteAs,
    ) -> Result<(), LaunchError> {
        match self {
            Self::Binary => {
                octomap::write_bt(path, &map.to_tree(Pruning::Full), &map.sensor().binary_values())?;
            }
            Self::Full => octomap::write_ot(path, &map.to_tree(Pruning::Full))?,
            Self::Centres => write_centres(path, map, write_as)?,
            Self::Grid => {
                occupancy_grid::write(&path.with_extension("yaml"), &flat_map::project(map, flat)?)?
            }
            Self::Picture => flat_map::picture(&flat_map::project(map, flat)?).write_png(path)?,
        }
        Ok(())
    }
}

pub(super) fn is_occupied(map: &OctreeMap, voxel: &Voxel) -> bool {
    voxel.flags & voxel_flags::KNOWN != 0 && map.sensor().is_occupied(voxel.log_odds)
}

/// The centres of the occupied voxels, in the order of an octree's leaves.
pub(crate) fn centres(map: &OctreeMap) -> Vec<CloudPoint> {
    let occupied = map.voxels().filter(|voxel| is_occupied(map, voxel));
    occupied
        .map(|voxel| {
            let [x, y, z] = map.space().centre(voxel.key).map(|axis| axis as f32);
            CloudPoint { x, y, z, intensity: 0.0 }
        })
        .collect()
}

pub(crate) fn write_centres(path: &Path, map: &OctreeMap, write_as: WriteAs) -> Result<(), FormatError> {
    pcd::write(path, centres(map).into_iter(), Intensity::Dropped, write_as)
}
