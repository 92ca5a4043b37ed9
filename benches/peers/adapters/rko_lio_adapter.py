"""rko-lio: point to point with the IMU for the prediction, without a model of its noise."""

from __future__ import annotations

from typing import Any, Callable

import numpy as np
from rko_lio.config import LIOConfig
from rko_lio.lio import LIO
from rko_lio.rko_lio_pybind import InputError

from recording.livox import Frame
from recording.wt901c import ImuSamples

from . import Pose

_SETTINGS: dict[str, Any] = {
    # "I highly recommend enabling this" where the walk starts from rest, as all of these do.
    "initialization_phase": True,
    # Its documentation's advice for scenes in buildings. With 0.5 m before a blank wall it refuses scans as thinned too
    # much, with its default of 1 m it gives up there.
    "double_downsample": False,
    "voxel_size": 0.25,
}


class _RkoLio:
    """Its base frame is the LiDAR, so that its pose needs no conversion; it is that of the scan's last point."""

    def __init__(self, imu_from_lidar: np.ndarray) -> None:
        self.settings = dict(_SETTINGS)
        self._lio = LIO(LIOConfig(max_num_threads=1, **_SETTINGS))
        self._lidar_from_imu = np.linalg.inv(imu_from_lidar)
        self._early: ImuSamples | None = None

    def prepare(self, frame: Frame, imu: ImuSamples) -> Callable[[], Pose | None]:
        end_ns = int(frame.times_ns[-1])

        def register() -> Pose | None:
            for samples in (self._early, imu):
                self._add(samples, end_ns)
            self._early = imu[int(np.searchsorted(imu.times_ns, end_ns)) :]
            try:
                self._lio.register_scan(frame.points, frame.times_ns, np.eye(4))
            except InputError:
                return None
            return Pose(end_ns, np.array(self._lio.pose()))

        return register

    def _add(self, samples: ImuSamples | None, before_ns: int) -> None:
        """Samples from a scan's end on come with the next scan, as in its own sequencer."""
        if samples is None:
            return
        for time, accel, gyro in zip(samples.times_ns, samples.accel, samples.gyro):
            if time < before_ns:
                self._lio.add_imu_measurement(accel, gyro, int(time), self._lidar_from_imu)


def start(imu_from_lidar: np.ndarray) -> _RkoLio:
    """See `adapters.load`."""
    return _RkoLio(imu_from_lidar)
