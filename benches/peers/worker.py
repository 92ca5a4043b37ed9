"""One peer on one walk, in a process of its own: `worker.py PEER WALK_FOLDER OUTPUT_FOLDER`.

Writes trajectory.tum and figures.json. Frames are read one at a time, and only the peer's own call is timed.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import adapters
import processes
from recording import livox, rig, trajectory
from recording.walk import Walk
from recording.wt901c import ImuSamples

BASE_NS = 1_000_000_000_000
"""Added to every stamp that a peer sees; see `adapters`."""


def main(peer: str, folder: Path, output: Path) -> None:
    """Runs it and writes the files."""
    walk = Walk(folder.name, folder)
    imu = walk.imu_samples()
    imu = ImuSamples(imu.times_ns + BASE_NS, imu.accel, imu.gyro)
    adapter = adapters.load(peer, rig.read_toml(walk.rig).imu_from_lidar)
    before_mb = processes.peak_memory_mb("self")
    poses: list[adapters.Pose] = []
    wall: list[float] = []
    cpu: list[float] = []
    used = 0
    for frame in livox.frames(walk.lidar):
        if len(frame.points) == 0:
            continue
        frame = replace(frame, start_ns=frame.start_ns + BASE_NS, times_ns=frame.times_ns + BASE_NS)
        until = int(np.searchsorted(imu.times_ns, frame.end_ns)) + 1
        register = adapter.prepare(frame, imu[used:until])
        used = until
        wall_start, cpu_start = time.perf_counter(), time.process_time()
        pose = register()
        # Of all threads of this process.
        cpu.append(1e3 * (time.process_time() - cpu_start))
        wall.append(1e3 * (time.perf_counter() - wall_start))
        if pose is not None:
            poses.append(pose)
    times = [pose.time_ns - BASE_NS for pose in poses]
    trajectory.write_tum(output / "trajectory.tum", trajectory.from_matrices(times, [pose.matrix for pose in poses]))
    figures = {
        "settings": adapter.settings,
        "frames": len(wall),
        "cpu_ms_mean": float(np.mean(cpu)),
        "wall_ms_p50": float(np.percentile(wall, 50)),
        "wall_ms_p99": float(np.percentile(wall, 99)),
        "memory_mb": processes.peak_memory_mb("self"),
        "memory_before_mb": before_mb,
    }
    (output / "figures.json").write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
