"""The walks of a run."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import environment
import ours
from recording.walk import Walk, open_walk

SIMULATED = (("corridor", 11), ("corridor", 12), ("hall", 21))
"""World and seed of the walks that are recorded for the run."""
GIVEN = ("corridor", "hall", "shake")
"""Walks of the test data, made by another simulator."""


def given_by(folders: list[Path], output: Path) -> list[Walk]:
    """The user's own recordings."""
    walks = []
    for folder in folders:
        walk = open_walk(folder.resolve(), output / "walks")
        if walk is None:
            sys.exit(f"{folder} has no {Walk.LIDAR} and no {Walk.LIDAR}.xz")
        walks.append(walk)
    return walks


def default(evac: Path, output: Path) -> list[Walk]:
    """The walks of the test data where it is there, and simulated ones."""
    walks = []
    for name in GIVEN:
        walk = open_walk(_data() / "simulated" / name, output / "walks")
        if walk is None:
            print(f"skipped: the walk {name} is not in the test data (set EVAC_DATA to the folder that has it)")
        else:
            walks.append(walk)
    for world, seed in SIMULATED:
        name = f"{world}-seed{seed}"
        folder = output / "walks" / name
        print(f"recording {name}", file=sys.stderr, flush=True)
        ours.record(evac, world, seed, folder, output / "recorded" / name)
        walks.append(Walk(name, folder))
    return walks


def _data() -> Path:
    folder = os.environ.get("EVAC_DATA")
    return Path(folder) if folder else environment.REPOSITORY.parent / "shared" / "data"
