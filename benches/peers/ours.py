"""evac itself: simulated walks to record, and `evac map` on a recording."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import processes
from recording.walk import Walk

NAME = "evac"
_LOOK_EVERY_S = 0.01
_PATIENCE_S = 20.0
_ODOMETRY = ("deskewer", "lio")
"""The stages that do what a peer does. The others read the recording, build the maps and write files."""


def record(evac: Path, world: str, seed: int, folder: Path, results: Path, duration_s: float | None = None) -> None:
    """Walks through a simulated building, to its end or for a while, and records it."""
    command = [
        str(evac),
        "demo",
        "--world",
        world,
        "--seed",
        str(seed),
        "--record",
        str(folder),
        "-o",
        str(results),
    ]
    if duration_s is not None:
        command += ["--duration", str(duration_s)]
    command += ["--domain", f"peers-{os.getpid()}", "--log-level", "warn"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def run(evac: Path, walk: Walk, output: Path, timeout_s: float, extra: Sequence[str] = ()) -> dict[str, Any]:
    """Maps a walk into `output`, where trajectory.tum then is, and returns the figures that a peer's worker gives.

    Raises subprocess.CalledProcessError or TimeoutExpired. The time limit ends the whole pipeline, by SIGTERM.
    """
    files = ["--lidar", walk.lidar, "--imu", walk.imu, "--rig", walk.rig, "-o", output]
    command = [str(word) for word in (evac, "map", *files, *extra, "--log-level", "warn")]
    with open(output / "log.txt", "w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        watch, before = processes.Watch(process.pid), processes.ended_children_cpu_s()
        deadline = time.monotonic() + timeout_s
        while process.poll() is None:
            watch.look()
            if time.monotonic() > deadline:
                _end(process)
                raise subprocess.TimeoutExpired(command, timeout_s)
            time.sleep(_LOOK_EVERY_S)
    if process.returncode != 0:
        raise subprocess.CalledProcessError(process.returncode, command)
    summary = json.loads((output / "summary.json").read_text())
    whole = processes.ended_children_cpu_s() - before
    return _figures(summary, list(watch.seen.values()), whole)


def _end(process: subprocess.Popen[bytes]) -> None:
    """As an operator would; its stages end with it in either case."""
    process.terminate()
    try:
        process.wait(_PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _figures(summary: dict[str, Any], usages: list[processes.Usage], whole_cpu_s: float) -> dict[str, Any]:
    frames = summary["frames"]
    odometry = [usage for usage in usages if any(f"stage {name}" in usage.command for name in _ODOMETRY)]
    if len(odometry) != len(_ODOMETRY):
        print(f"warning: {len(odometry)} processes of {_ODOMETRY} seen", file=sys.stderr)
    stages = summary["stages"]
    compute = [stages[name]["latency"]["compute"] for name in _ODOMETRY]
    return {
        "settings": {},
        "frames": frames,
        "cpu_ms_mean": 1e3 * sum(usage.cpu_s for usage in odometry) / frames,
        "wall_ms_p50": sum(stage["p50_ms"] for stage in compute),
        "wall_ms_p99": sum(stage["p99_ms"] for stage in compute),
        "memory_mb": sum(usage.peak_mb for usage in odometry),
        "lio_compute": stages["lio"]["latency"]["compute"],
        "pipeline_cpu_ms_mean": 1e3 * whole_cpu_s / frames,
        "pipeline_memory_mb": sum(usage.peak_mb for usage in usages),
        "stages": {usage.command: {"cpu_s": usage.cpu_s, "peak_mb": usage.peak_mb} for usage in usages},
    }
