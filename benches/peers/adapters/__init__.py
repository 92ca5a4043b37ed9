"""One file for each peer: what its own reader would do with the same data, through its public Python API.

An adapter gets frame after frame and the IMU samples between, and says where the LiDAR was. It is given points in the
LiDAR's frame and samples in the IMU's frame; it knows the rig. Stamps begin at 1000 s, since a stamp of zero means "not
yet" to some.
"""

from __future__ import annotations

import importlib
from typing import Any, Callable, NamedTuple, Protocol

import numpy as np

from recording.livox import Frame
from recording.wt901c import ImuSamples

NAMES = ("genz-lio", "rko-lio", "kiss-icp")
"""All peers, by their names on PyPI."""


class Pose(NamedTuple):
    """Where the LiDAR was."""

    time_ns: int
    matrix: np.ndarray
    """4x4, LiDAR to the peer's own fixed frame."""


class Adapter(Protocol):
    """A peer that is ready for the first frame."""

    settings: dict[str, Any]
    """What differs from the package's defaults, for the report."""

    def prepare(self, frame: Frame, imu: ImuSamples) -> Callable[[], Pose | None]:
        """Brings one frame into the form that the peer takes, and returns the call that registers it.

        Only that call is timed. `imu` holds the samples since the last frame's, up to the first one at or after the
        frame's end, so that the motion is covered. The call returns None where the peer gives no pose for the frame.
        """
        ...


def load(name: str, imu_from_lidar: np.ndarray) -> Adapter:
    """Starts a peer with the rig's extrinsic (4x4), on one thread where it has a setting for that."""
    module = importlib.import_module(f"adapters.{name.replace('-', '_')}_adapter")
    return module.start(imu_from_lidar)
