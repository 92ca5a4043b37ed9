"""kiss-icp: LiDAR alone, point to point, constant velocity."""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
from kiss_icp.config import load_config
from kiss_icp.kiss_icp import KissICP

from recording.livox import Frame
from recording.wt901c import ImuSamples

from . import Pose

_MAX_RANGE_M = 50.0
"""Its authors' advice for buildings (README of their kiss-slam); the voxels follow with 0.5 m."""


class _KissIcp:
    """It deskews to the time of the last point, and its pose is the LiDAR's then."""

    def __init__(self) -> None:
        config = load_config(None)
        config.data.max_range = _MAX_RANGE_M
        config.mapping.voxel_size = _MAX_RANGE_M / 100
        config.registration.max_num_threads = 1
        self._odometry = KissICP(config)
        self.settings: dict[str, Any] = {"max_range": _MAX_RANGE_M, "voxel_size": _MAX_RANGE_M / 100}

    def prepare(self, frame: Frame, imu: ImuSamples) -> Callable[[], Pose]:
        del imu
        seconds = (frame.times_ns - frame.start_ns) * 1e-9
        end_ns = int(frame.times_ns[-1])

        def register() -> Pose:
            self._odometry.register_frame(frame.points, seconds)
            return Pose(end_ns, np.array(self._odometry.last_pose))

        return register


def start(imu_from_lidar: np.ndarray) -> _KissIcp:
    """See `adapters.load`; it has no IMU, and so no extrinsic."""
    del imu_from_lidar
    return _KissIcp()
