"""Where the LiDAR sits on the IMU: `rig.toml` as evac reads it, or `meta.json` of the given walks."""

from __future__ import annotations

import ast
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Rig:
    """Lever arm and Euler angles of the LiDAR in the IMU's frame."""

    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roll_pitch_yaw_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def imu_from_lidar(self) -> np.ndarray:
        """4x4: takes LiDAR to IMU coordinates; R = Rz(yaw) Ry(pitch) Rx(roll)."""
        roll, pitch, yaw = np.radians(self.roll_pitch_yaw_deg)
        matrix = np.eye(4)
        matrix[:3, :3] = _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)
        matrix[:3, 3] = self.translation_m
        return matrix

    def toml(self) -> str:
        """The file that `evac map --rig` takes."""
        return (
            "[rig.imu_from_lidar]\n"
            f"translation_m = {list(map(float, self.translation_m))}\n"
            f"roll_pitch_yaw_deg = {list(map(float, self.roll_pitch_yaw_deg))}\n"
        )


def read_toml(path: Path) -> Rig:
    """Reads the two arrays of a rig file; a file without them has the sensors in one place.

    Python 3.9 has no TOML reader, and evac writes and accepts nothing else here.
    """
    found = {"translation_m": (0.0, 0.0, 0.0), "roll_pitch_yaw_deg": (0.0, 0.0, 0.0)}
    for line in Path(path).read_text().splitlines():
        key, equals, value = (part.strip() for part in line.split("#")[0].partition("="))
        if not equals:
            continue
        if key not in found:
            raise ValueError(f"{path}: unknown key {key}")
        x, y, z = map(float, ast.literal_eval(value))
        found[key] = (x, y, z)
    return Rig(found["translation_m"], found["roll_pitch_yaw_deg"])


def read_meta(path: Path) -> Rig:
    """Reads the extrinsic of a given walk: x, y, z in metres, then yaw, pitch, roll in degrees."""
    x, y, z, yaw, pitch, roll = json.loads(Path(path).read_text())["T_imu_lidar_xyz_ypr"]
    return Rig((x, y, z), (roll, pitch, yaw))


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation about a coordinate axis."""
    rotation = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation[i, i] = rotation[j, j] = np.cos(angle)
    rotation[j, i] = np.sin(angle)
    rotation[i, j] = -rotation[j, i]
    return rotation
