"""The virtual environment with the pinned peers, and this program inside it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent
FOLDER = REPOSITORY / "target" / "peers-venv"
PYTHON = FOLDER / "bin" / "python"
_REQUIREMENTS = HERE / "requirements.txt"
_VERSIONS = ((3, 10), (3, 12))
"""What all three peers have wheels for."""


def inside() -> bool:
    """Whether this is the environment's Python."""
    return Path(sys.prefix).resolve() == FOLDER.resolve()


def enter() -> NoReturn:
    """Makes the environment where it is missing or of other versions, and starts this program again in it."""
    stamp = FOLDER / "requirements.txt"
    wanted = _REQUIREMENTS.read_bytes()
    if not PYTHON.exists() or not stamp.exists() or stamp.read_bytes() != wanted:
        print(f"installing the peers into {FOLDER}", file=sys.stderr, flush=True)
        subprocess.run([_interpreter(), "-m", "venv", "--clear", str(FOLDER)], check=True)
        pip = [str(PYTHON), "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        subprocess.run([*pip, "-r", str(_REQUIREMENTS)], check=True)
        stamp.write_bytes(wanted)
    os.execv(str(PYTHON), [str(PYTHON), *sys.argv])


def _interpreter() -> str:
    """A Python that the peers can be installed for."""
    oldest, newest = _VERSIONS
    if oldest <= sys.version_info[:2] <= newest:
        return sys.executable
    for minor in range(newest[1], oldest[1] - 1, -1):
        found = shutil.which(f"python3.{minor}")
        if found and subprocess.run([found, "-c", ""], capture_output=True).returncode == 0:
            return found
    sys.exit(f"the peers need Python 3.{oldest[1]} to 3.{newest[1]}; this is {sys.version.split()[0]}")
