"""Trajectories: TUM files, and poses between two stamps."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Trajectory:
    """Poses of the LiDAR in some fixed frame, in rising order of time."""

    times_ns: np.ndarray
    """(N,)"""
    positions: np.ndarray
    """(N, 3), metres."""
    quaternions: np.ndarray
    """(N, 4), unit, x y z w."""

    def __len__(self) -> int:
        return len(self.times_ns)

    def shifted(self, by_ns: int) -> Trajectory:
        """The same poses at other times."""
        return Trajectory(self.times_ns + by_ns, self.positions, self.quaternions)


def from_matrices(times_ns: list[int], matrices: list[np.ndarray]) -> Trajectory:
    """From 4x4 matrices."""
    stack = np.asarray(matrices, dtype=np.float64).reshape(-1, 4, 4)
    quaternions = np.asarray([_quaternion(m[:3, :3]) for m in stack]).reshape(-1, 4)
    return Trajectory(np.asarray(times_ns, dtype=np.int64), stack[:, :3, 3], quaternions)


def read_tum(path: Path) -> Trajectory:
    """Reads `seconds x y z qx qy qz qw` lines. Stamps are decimals of full length, so no nanosecond is lost."""
    rows = [line.split() for line in Path(path).read_text().splitlines() if line and not line.startswith("#")]
    times = [int((Decimal(row[0]) * 10**9).to_integral_value()) for row in rows]
    values = np.asarray([[float(word) for word in row[1:8]] for row in rows]).reshape(-1, 7)
    norms = np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    return Trajectory(np.asarray(times, dtype=np.int64), values[:, :3], values[:, 3:] / norms)


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Writes what `read_tum` and evo read."""
    with open(path, "w") as file:
        for time, position, quaternion in zip(trajectory.times_ns, trajectory.positions, trajectory.quaternions):
            numbers = " ".join(f"{value:.9f}" for value in (*position, *quaternion))
            file.write(f"{time // 10**9}.{time % 10**9:09d} {numbers}\n")


def rotations(quaternions: np.ndarray) -> np.ndarray:
    """(N, 3, 3) rotation matrices of (N, 4) unit quaternions."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.asarray(rows), 2, 0)


def at(trajectory: Trajectory, times_ns: np.ndarray) -> Trajectory:
    """Poses at other times within the trajectory: positions linearly, orientations along the shortest arc."""
    after = np.clip(np.searchsorted(trajectory.times_ns, times_ns), 1, len(trajectory) - 1)
    before = after - 1
    start, stop = trajectory.times_ns[before], trajectory.times_ns[after]
    share = ((times_ns - start) / (stop - start))[:, None]
    positions = (1 - share) * trajectory.positions[before] + share * trajectory.positions[after]
    first, second = trajectory.quaternions[before], trajectory.quaternions[after]
    cosine = np.sum(first * second, axis=1, keepdims=True)
    second = np.where(cosine < 0, -second, second)
    angle = np.arccos(np.clip(np.abs(cosine), 0, 1))
    # Below a microradian sin(a)/a is 1 to the last digit.
    small = angle < 1e-6
    sine = np.where(small, 1, np.sin(angle))
    weight = np.where(small, share, np.sin(share * angle) / sine)
    rest = np.where(small, 1 - share, np.sin((1 - share) * angle) / sine)
    return Trajectory(np.asarray(times_ns), positions, rest * first + weight * second)


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """x y z w of a rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix, exact at every angle."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    if not np.isfinite(k).all():
        return np.full(4, np.nan)
    return np.linalg.eigh(k, UPLO="L")[1][:, -1]
