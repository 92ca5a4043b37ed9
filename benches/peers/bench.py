"""One system on one walk, and what it ran on."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import adapters
import environment
import metrics
import ours
from recording import trajectory
from recording.walk import Walk

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Result:
    """What came of it. A system that fails has no accuracy, and a reason."""

    walk: str
    system: str
    figures: dict[str, Any]
    accuracy: metrics.Accuracy | None
    failure: str | None


def run(system: str, walk: Walk, evac: Path, output: Path, timeout_s: float) -> Result:
    """Runs it in processes of its own. A crash, a time-out and a useless trajectory are results too."""
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    figures: dict[str, Any] = {}
    try:
        if system == ours.NAME:
            figures = ours.run(evac, walk, output, timeout_s)
        else:
            figures = _peer(system, walk, output, timeout_s)
        accuracy = metrics.accuracy(walk.true_trajectory(), trajectory.read_tum(output / "trajectory.tum"))
    except subprocess.TimeoutExpired:
        return Result(walk.name, system, figures, None, f"not done after {timeout_s:.0f} s")
    except subprocess.CalledProcessError as error:
        reason = f"crashed ({_ending(error.returncode)}): {_last_line(output / 'log.txt')}"
        return Result(walk.name, system, figures, None, reason)
    except ValueError as error:
        return Result(walk.name, system, figures, None, figures.get("failure") or str(error))
    if figures.get("failure"):
        until = f"after {figures['frames']} frames, APE until then {accuracy.ape_rmse_m:.3f} m"
        return Result(walk.name, system, figures, None, f"crashed {until}: {figures['failure']}")
    return Result(walk.name, system, figures, accuracy, None)


def _peer(name: str, walk: Walk, output: Path, timeout_s: float) -> dict[str, Any]:
    command = [sys.executable, str(environment.HERE / "worker.py"), name, str(walk.folder), str(output)]
    one_thread = {variable: "1" for variable in _ONE_THREAD}
    with open(output / "log.txt", "w") as log:
        subprocess.run(command, check=True, timeout=timeout_s, stdout=log, stderr=log, env={**os.environ, **one_thread})
    figures: dict[str, Any] = json.loads((output / "figures.json").read_text())
    return figures


def machine() -> dict[str, Any]:
    """What absolute times are worth: the processor, and how busy it was."""
    model = ""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    return {
        "processor": model or platform.machine(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "load_average_at_end": os.getloadavg(),
    }


def versions(evac: Path) -> dict[str, str]:
    """Versions of all systems."""
    version = subprocess.run([str(evac), "--version"], check=True, capture_output=True, text=True)
    found: list[str] = version.stdout.split()
    return {ours.NAME: found[-1], **{name: metadata.version(name) for name in adapters.NAMES}}


def _ending(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def _last_line(log: Path) -> str:
    lines = [line.strip() for line in log.read_text(errors="replace").splitlines() if line.strip()]
    return lines[-1][:160] if lines else "it said nothing"
