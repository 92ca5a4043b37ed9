//! The map itself: single voxels in and out.

use evac_frames::{Voxel, voxel_flags};

use crate::apply::{Marked, StoreWork};
use crate::bricks::{Bricks, SHARDS};
use crate::coarse::CoarseCaster;
use crate::directory::Near;
use crate::marks::ScanMarks;
use crate::mask::{has, range};
use crate::morton::{self, BRICK_BITS};
use crate::rays::{Caster, Helper, Ray};
use crate::{Key, KeySpace, MapError, Occupancy, Rejected, SensorModel};

/// What a map is made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapConfig {
    /// Edge of a voxel, metres.
    pub resolution: f64,
    /// How rays change voxels.
    pub sensor: SensorModel,
    /// Bytes that the map may take ([`OctreeMap::memory_bytes`]). From seven eighths on no new place is taken in: its bricks
    /// of 8 x 8 x 8 voxels are refused and counted in [`crate::ScanReport::refused_bricks`], those first in Morton order
    /// stay. What is in the map keeps its voxels and every update of them; the last eighth is for the bits that
    /// this needs, since a brick takes 32 bytes where all its voxels are equal, up to 1 kB where many different values
    /// are in it, and 2 kB where a map has more than 65,535 values at a time.
    /// [`OctreeMap::scratch_bytes`] is apart, in proportion to the largest scan.
    pub max_bytes: usize,
    /// Threads that insert a scan, the calling one included; 0 counts as 1, more than 8 as 8. The map is the same with any
    /// number. Starting them costs some 50 microseconds a scan and allocates.
    pub threads: u32,
}

impl MapConfig {
    /// OctoMap's sensor model and a ceiling of 512 MiB: some 1.4 million bricks, 700,000 cubic metres at 0.1 m.
    pub fn new(resolution: f64) -> Self {
        Self { resolution, sensor: SensorModel::default(), max_bytes: 512 << 20, threads: 1 }
    }
}

/// Least ceiling: an empty map's palette and a few pages.
const LEAST_BYTES: usize = 64 << 10;

/// A sparse voxel map with OctoMap's semantics.
#[derive(Debug)]
pub struct OctreeMap {
    pub(crate) space: KeySpace,
    pub(crate) sensor: SensorModel,
    pub(crate) bricks: Bricks,
    pub(crate) marks: ScanMarks,
    pub(crate) rays: Vec<Ray>,
    pub(crate) caster: Caster,
    /// Where coarse free space was asked for.
    pub(crate) coarse: Option<CoarseCaster>,
    /// One for each thread but the first.
    pub(crate) helpers: Vec<Helper>,
    pub(crate) threads: usize,
    /// The bricks that the last scan marked, in Morton order.
    pub(crate) marked: Vec<Marked>,
    /// What it did to them, by store.
    pub(crate) work: Vec<StoreWork>,
    /// Voxels with a log-odds value.
    pub(crate) known: usize,
    /// Voxels with a value or a flag.
    pub(crate) listed: usize,
    /// Voxels that the last scan changed.
    pub(crate) changed: usize,
    /// Number of the last scan.
    pub(crate) scan: u32,
    /// Number of the last change.
    pub(crate) revision: u32,
    /// Number of the last change that took voxels out.
    pub(crate) removal: u32,
}

impl OctreeMap {
    /// An empty map.
    ///
    /// # Errors
    /// [`MapError`] where the resolution is no length, the sensor model none, or the ceiling is below 64 KiB.
    pub fn new(config: MapConfig) -> Result<Self, MapError> {
        let MapConfig { resolution, sensor, max_bytes, threads } = config;
        let threads = (threads as usize).clamp(1, SHARDS);
        let space = KeySpace::new(resolution).ok_or(MapError::Resolution(resolution))?;
        if !sensor.is_valid() {
            return Err(MapError::Sensor(sensor));
        }
        if max_bytes < LEAST_BYTES {
            return Err(MapError::Ceiling { max_bytes });
        }
        Ok(Self {
            space,
            sensor,
            bricks: Bricks::new(max_bytes, sensor),
            marks: ScanMarks::new(max_bytes),
            rays: Vec::new(),
            caster: Caster::default(),
            coarse: None,
            helpers: (1..threads).map(|_| Helper::new(max_bytes)).collect(),
            threads,
            marked: Vec::new(),
            work: (0..SHARDS).map(|_| StoreWork::default()).collect(),
            known: 0,
            listed: 0,
            changed: 0,
            scan: 0,
            revision: 0,
            removal: 0,
        })
    }

    /// Coordinates and keys of this map.
    pub fn space(&self) -> &KeySpace {
        &self.space
    }

    /// How rays change voxels.
    pub fn sensor(&self) -> &SensorModel {
        &self.sensor
    }

    /// Voxels with a log-odds value.
    pub fn known(&self) -> usize {
        self.known
    }

    /// Bricks of 8 x 8 x 8 voxels in the map.
    pub fn bricks(&self) -> u32 {
        self.bricks.len()
    }

    /// Bytes that the voxels and their directory take, free ones among them included; not the scratch of a scan.
    pub fn memory_bytes(&self) -> usize {
        self.bricks.memory_bytes()
    }

    /// Those of [`Self::memory_bytes`] that hold nothing at present and are used again before more are taken.
    pub fn free_bytes(&self) -> usize {
        self.bricks.free_bytes()
    }

    /// Bytes that are kept from scan to scan to work in. Grows with the largest scan, not with the map.
    pub fn scratch_bytes(&self) -> usize {
        self.marks.memory_bytes()
            + self.rays.capacity() * size_of::<Ray>()
            + self.caster.memory_bytes()
            + self.coarse.as_ref().map_or(0, CoarseCaster::memory_bytes)
            + self.helpers.iter().map(Helper::memory_bytes).sum::<usize>()
            + self.marked.capacity() * size_of::<Marked>()
            + self.work.iter().map(StoreWork::memory_bytes).sum::<usize>()
    }

    /// One hit or miss at a point, without a ray: OctoMap's `updateNode(point, hit)`. Gives the new log-odds.
    ///
    /// # Errors
    /// [`Rejected`]; the map is unchanged.
    pub fn update_node(&mut self, point: [f32; 3], hit: bool) -> Result<f32, Rejected> {
        if !point.iter().all(|c| c.is_finite()) {
            return Err(Rejected::NotFinite);
        }
        let key = self.space.key(point).ok_or(Rejected::OutsideKeySpace)?;
        let old = self.log_odds(key).unwrap_or(0.0);
        let log_odds = if hit { self.sensor.struck(old) } else { self.sensor.missed(old) };
        self.set_voxel(key, log_odds)?;
        Ok(log_odds)
    }

    /// Sets a voxel's log-odds as they are, beyond the clamps if need be.
    ///
    /// # Errors
    /// [`Rejected`]; the map is unchanged.
    pub fn set_voxel(&mut self, key: Key, log_odds: f32) -> Result<(), Rejected> {
        // Minus zero would be another value than zero in files, and equal to it in pruning.
        let log_odds = log_odds + 0.0;
        if !log_odds.is_finite() {
            return Err(Rejected::NotFinite);
        }
        let (place, voxel) = self.find_or_add(key)?;
        if self.bricks.value(place, voxel).is_none() {
            self.known += 1;
            self.listed += usize::from(!has(&self.bricks.ground(place), voxel));
        }
        self.revision = self.revision.wrapping_add(1);
        self.bricks.assign(place, &range(voxel, 1), log_odds, self.revision);
        Ok(())
    }

    /// Gives a voxel the ground flag. It may stay unknown.
    ///
    /// # Errors
    /// [`Rejected`]; the map is unchanged.
    pub fn set_ground(&mut self, key: Key) -> Result<(), Rejected> {
        let (place, voxel) = self.find_or_add(key)?;
        if has(&self.bricks.ground(place), voxel) {
            return Ok(());
        }
        self.listed += usize::from(self.bricks.value(place, voxel).is_none());
        self.revision = self.revision.wrapping_add(1);
        let (store, index) = self.bricks.at_mut(place);
        store.add_ground(index, &range(voxel, 1));
        store.set_revision(index, self.revision);
        Ok(())
    }

    /// Takes over a voxel of another map's [`OctreeMap::changes`] or [`OctreeMap::voxels`]; one without any flag is gone, see
    /// [`OctreeMap::forget_unseen_with`].
    ///
    /// # Errors
    /// [`Rejected`]; the map is unchanged.
    pub fn apply(&mut self, voxel: &Voxel) -> Result<(), Rejected> {
        if voxel.flags == 0 {
            self.delete_box(voxel.key, voxel.key);
        }
        if voxel.flags & voxel_flags::KNOWN != 0 {
            self.set_voxel(voxel.key, voxel.log_odds)?;
        }
        if voxel.flags & voxel_flags::GROUND != 0 {
            self.set_ground(voxel.key)?;
        }
        Ok(())
    }

    /// Log-odds of a voxel; `None` where it is unknown.
    #[inline]
    pub fn log_odds(&self, key: Key) -> Option<f32> {
        let (brick, voxel) = split(key);
        self.bricks.value(self.bricks.find(brick)?, voxel)
    }

    /// What is known of a voxel.
    #[inline]
    pub fn occupancy(&self, key: Key) -> Occupancy {
        self.occupancy_of(self.log_odds(key))
    }

    #[inline]
    pub(crate) fn occupancy_of(&self, log_odds: Option<f32>) -> Occupancy {
        match log_odds {
            None => Occupancy::Unknown,
            Some(value) if self.sensor.is_occupied(value) => Occupancy::Occupied,
            Some(_) => Occupancy::Free,
        }
    }

    /// Whether a ground point was seen in a voxel.
    #[inline]
    pub fn is_ground(&self, key: Key) -> bool {
        let (brick, voxel) = split(key);
        self.bricks.find(brick).is_some_and(|place| has(&self.bricks.ground(place), voxel))
    }

    fn find_or_add(&mut self, key: Key) -> Result<(u32, usize), Rejected> {
        let (brick, voxel) = split(key);
        let place = self.bricks.find_or_add_one(brick, &mut Near::default()).ok_or(Rejected::Full)?;
        Ok((place, voxel))
    }
}

/// Code of the brick that holds a voxel, and the voxel's number in it.
#[inline]
pub(crate) fn split(key: Key) -> (u64, usize) {
    let code = morton::encode(key);
    (code >> BRICK_BITS, (code & ((1 << BRICK_BITS) - 1)) as usize)
}
