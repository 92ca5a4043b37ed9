//! The map as the mapper has it.

use std::time::{Duration, Instant};

use evac_octree::{MapConfig, OctreeMap};
use evac_ports::services::{MapSnapshot, SNAPSHOT_REQUEST};
use evac_ports::{Bus, FrameSubscriber, RequestSender};

use crate::error::LaunchError;

/// How long the mapper may take for a snapshot.
const PATIENCE: Duration = Duration::from_secs(20);

/// Bytes of `map.ot` as the mapper itself would write it now; empty where it does not answer.
pub(super) fn of_mapper(bus: &Bus, stop: impl Fn() -> bool) -> Result<Vec<u8>, LaunchError> {
    let (snapshots, _) = FrameSubscriber::<MapSnapshot>::open(bus)?;
    let request = RequestSender::open(bus, SNAPSHOT_REQUEST)?;
    let until = Instant::now() + PATIENCE;
    while Instant::now() < until && !stop() {
        request.send()?;
        std::thread::sleep(Duration::from_millis(200));
        let Some(snapshot) = snapshots.receive()? else { continue };
        let refused = |cause: String| LaunchError::Silent(format!("map/snapshot: {cause}"));
        let mut map = OctreeMap::new(MapConfig::new(snapshot.header().resolution))
            .map_err(|cause| refused(cause.to_string()))?;
        for voxel in snapshot.items() {
            map.apply(voxel).map_err(|cause| refused(format!("{cause:?}")))?;
        }
        return Ok(map.ot_bytes());
    }
    Ok(Vec::new())
}
