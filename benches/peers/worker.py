"""One peer on one walk, in a process of its own: `worker.py PEER WALK_FOLDER OUTPUT_FOLDER`.

Writes trajectory.tum and figures.json. Frames are read one at a time, and only the peer's own call is timed.
"""

from __future__ import annotations

import json
import sys
import time
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import adapters
import processes
from recording import livox, rig, trajectory
from recording.walk import Walk
from recording.wt901c import ImuSamples

BASE_NS = 1_000_000_000_000
"""Added to every stamp that a peer sees; see `adapters`."""


class Run:
    """A peer on a walk, and what it has given and used so far."""

    def __init__(self, peer: str, walk: Walk) -> None:
        imu = walk.imu_samples()
        self._walk = walk
        self._imu = ImuSamples(imu.times_ns + BASE_NS, imu.accel, imu.gyro)
        self._adapter = adapters.load(peer, rig.read_toml(walk.rig).imu_from_lidar)
        self._memory_before_mb = processes.peak_memory_mb("self")
        self._poses: list[adapters.Pose] = []
        self._wall_ms: list[float] = []
        self._cpu_ms: list[float] = []

    def all_frames(self) -> None:
        """From the first frame to the last; what the peer raises ends it."""
        used = 0
        for frame in livox.frames(self._walk.lidar):
            if len(frame.points) == 0:
                continue
            frame = replace(frame, start_ns=frame.start_ns + BASE_NS, times_ns=frame.times_ns + BASE_NS)
            until = int(np.searchsorted(self._imu.times_ns, frame.end_ns)) + 1
            register = self._adapter.prepare(frame, self._imu[used:until])
            used = until
            wall, cpu = time.perf_counter(), time.process_time()
            pose = register()
            # Of all threads of this process.
            self._cpu_ms.append(1e3 * (time.process_time() - cpu))
            self._wall_ms.append(1e3 * (time.perf_counter() - wall))
            if pose is not None:
                self._poses.append(pose)

    def trajectory(self) -> trajectory.Trajectory:
        """On the recording's clock."""
        times = [pose.time_ns - BASE_NS for pose in self._poses]
        return trajectory.from_matrices(times, [pose.matrix for pose in self._poses])

    def figures(self) -> dict[str, Any]:
        """What it cost."""
        frames = len(self._wall_ms)
        return {
            "settings": self._adapter.settings,
            "frames": frames,
            "cpu_ms_mean": float(np.mean(self._cpu_ms)) if frames else 0.0,
            "wall_ms_p50": float(np.percentile(self._wall_ms, 50)) if frames else 0.0,
            "wall_ms_p99": float(np.percentile(self._wall_ms, 99)) if frames else 0.0,
            "memory_mb": processes.peak_memory_mb("self"),
            "memory_before_mb": self._memory_before_mb,
        }


def main(peer: str, folder: Path, output: Path) -> None:
    """Runs it and writes the files; where the peer raises, up to there and with the reason."""
    run = Run(peer, Walk(folder.name, folder))
    failure = None
    try:
        run.all_frames()
    except Exception as error:  # whatever it is, it is a result
        failure = f"{type(error).__name__}: {error}"
        traceback.print_exc()
    trajectory.write_tum(output / "trajectory.tum", run.trajectory())
    (output / "figures.json").write_text(json.dumps({**run.figures(), "failure": failure}, indent=2))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
