"""genz-lio: iterated Kalman filter, point to plane and point to point weighed by how much planes constrain."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, Callable

import numpy as np
from genz_lio import GenZLIO, load_config
from genz_lio.genz_lio_pybind import _ScanBuffer
from genz_lio.packaged_configs import export_config

from recording.livox import Frame
from recording.wt901c import ImuSamples

from . import Pose

_PRESET = "experiments/narrowwide/mid70_tracked_01.yaml"
"""The best on the given walks of the package's four presets for a Mid-70, the sensor nearest to a Mid-40."""


class _GenzLio:
    """Fed through the buffer that its own reader of bags uses, which pairs scans and samples and checks the times."""

    def __init__(self, imu_from_lidar: np.ndarray) -> None:
        with tempfile.TemporaryDirectory() as folder:
            preset = Path(folder) / "preset.yaml"
            export_config(_PRESET, preset)
            config = load_config(preset)
        config.max_threads = 1
        config.mapping.extrinsic_t = imu_from_lidar[:3, 3]
        config.mapping.extrinsic_r = imu_from_lidar[:3, :3]
        self.settings: dict[str, Any] = {"preset": _PRESET}
        self._buffer = _ScanBuffer(config.preprocess)
        self._lio = GenZLIO(config)

    def prepare(self, frame: Frame, imu: ImuSamples) -> Callable[[], Pose | None]:
        samples = np.column_stack([imu.times_ns * 1e-9, imu.accel, imu.gyro])
        offsets = (frame.times_ns - frame.start_ns) * 1e-9

        def register() -> Pose | None:
            self._buffer.push_scan(frame.points, frame.start_ns * 1e-9, offsets)
            self._buffer.push_imu(samples)
            bundle = self._buffer.pop()
            if bundle is None:
                return None
            points, begin, end, paired, times, intensities, rings, _ = bundle
            result = self._lio.register_scan(
                points, begin, end, paired, times, intensities, rings, timing_prepared=True
            )
            if not result.valid:
                return None
            return Pose(round(result.timestamp * 1e9), np.array(self._lio.lidar_pose))

        return register


def start(imu_from_lidar: np.ndarray) -> _GenzLio:
    """See `adapters.load`."""
    return _GenzLio(imu_from_lidar)
