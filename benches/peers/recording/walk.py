"""A recorded walk: a folder as `evac demo --record` writes it, or one of the given simulated walks."""

from __future__ import annotations

import lzma
import shutil
from dataclasses import dataclass
from pathlib import Path

from . import livox, rig, trajectory, wt901c


@dataclass(frozen=True)
class Walk:
    """Files of one walk."""

    name: str
    folder: Path

    LIDAR = "lidar.pcap"
    IMU = "wt901c.bin"
    RIG = "rig.toml"
    TRUTH = "truth.tum"

    @property
    def lidar(self) -> Path:
        """Capture of the Mid-40."""
        return self.folder / self.LIDAR

    @property
    def imu(self) -> Path:
        """Byte log of the WT901C."""
        return self.folder / self.IMU

    @property
    def rig(self) -> Path:
        """Extrinsic, as `evac map --rig` takes it."""
        return self.folder / self.RIG

    @property
    def truth(self) -> Path:
        """True poses of the LiDAR at the end of every frame."""
        return self.folder / self.TRUTH

    def imu_samples(self) -> wt901c.ImuSamples:
        """All IMU samples. The log has no times: as for evac, its first sample is at the LiDAR's first shot."""
        return wt901c.parse(self.imu.read_bytes(), livox.first_stamp_ns(self.lidar))

    def true_trajectory(self) -> trajectory.Trajectory:
        """The truth on the LiDAR's clock: its first pose is at the end of the first frame, whatever its stamp."""
        truth = trajectory.read_tum(self.truth)
        first_end_ns = livox.first_stamp_ns(self.lidar) + livox.PERIOD_NS
        return truth.shifted(first_end_ns - int(truth.times_ns[0]))


def open_walk(folder: Path, unpack_into: Path) -> Walk | None:
    """The walk in a folder, None where there is none.

    A folder with packed files is unpacked below `unpack_into`, and gets the rig file and the names that evac uses.
    """
    if (folder / Walk.LIDAR).exists():
        return Walk(folder.name, folder)
    if not (folder / f"{Walk.LIDAR}.xz").exists():
        return None
    unpacked = unpack_into / folder.name
    unpacked.mkdir(parents=True, exist_ok=True)
    for name in (Walk.LIDAR, Walk.IMU):
        with lzma.open(folder / f"{name}.xz") as packed, open(unpacked / name, "wb") as file:
            shutil.copyfileobj(packed, file, 1 << 20)
    shutil.copyfile(folder / "gt.tum", unpacked / Walk.TRUTH)
    (unpacked / Walk.RIG).write_text(rig.read_meta(folder / "meta.json").toml())
    return Walk(folder.name, unpacked)
