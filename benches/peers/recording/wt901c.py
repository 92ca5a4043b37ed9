"""IMU samples out of the bytes that a WT901C sent over its serial line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_FRAME = 11
_SYNC = 0x55
_ACCEL, _GYRO = 0x51, 0x52
_KINDS = frozenset([*range(0x50, 0x5B), 0x5F])

ACCEL_SCALE = 16 * 9.80665 / 32768
"""m/s^2 a unit."""
GYRO_SCALE = float(np.radians(2000)) / 32768
"""rad/s a unit."""


@dataclass(frozen=True)
class ImuSamples:
    """Samples in the IMU's frame, in rising order of time."""

    times_ns: np.ndarray
    """(N,)"""
    accel: np.ndarray
    """(N, 3) specific force, m/s^2."""
    gyro: np.ndarray
    """(N, 3) angular velocity, rad/s."""

    def __len__(self) -> int:
        return len(self.times_ns)

    def __getitem__(self, part: slice) -> ImuSamples:
        return ImuSamples(self.times_ns[part], self.accel[part], self.gyro[part])


def parse(log: bytes, start_ns: int, rate_hz: float = 200.0) -> ImuSamples:
    """Samples of a log in which the sensor sent frames 0x51 and 0x52 for each.

    Sample k was measured at `start_ns + k / rate_hz`. Damaged bytes leave a gap in k, not a shift of what follows.
    """
    numbers: list[int] = []
    words: list[np.ndarray] = []
    accel = None
    position = 0
    while position + _FRAME <= len(log):
        frame = log[position : position + _FRAME]
        if not _is_frame(frame):
            position += 1
            continue
        if frame[1] == _ACCEL:
            accel = position
        elif frame[1] == _GYRO:
            if accel == position - _FRAME:
                numbers.append(round(accel / (2 * _FRAME)))
                words.append(np.frombuffer(log[accel + 2 : accel + 8] + frame[2:8], "<i2"))
            accel = None
        position += _FRAME
    if not numbers:
        raise ValueError("the log holds no pair of frames 0x51 (accelerometer) and 0x52 (gyroscope)")
    times = start_ns + np.rint(np.asarray(numbers) * (1e9 / rate_hz)).astype(np.int64)
    raw = np.asarray(words, dtype=np.float64)
    return ImuSamples(times, raw[:, :3] * ACCEL_SCALE, raw[:, 3:] * GYRO_SCALE)


def _is_frame(frame: bytes) -> bool:
    return frame[0] == _SYNC and frame[1] in _KINDS and sum(frame[:10]) & 0xFF == frame[10]
