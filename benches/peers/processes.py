"""What processes have used, from Linux's /proc."""

from __future__ import annotations

import os
import resource
from dataclasses import dataclass
from pathlib import Path

_TICK_S = 1 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Usage:
    """Of one process so far."""

    command: str
    """Its arguments, blank between."""
    cpu_s: float
    """User and system time of all its threads."""
    peak_mb: float
    """Most memory that it held, shared memory included."""


def peak_memory_mb(pid: int | str) -> float:
    """Most resident memory of a process, MB (10^6 bytes).

    Not `ru_maxrss`: after fork and exec that still counts the parent's memory.
    """
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise ProcessLookupError(f"process {pid} has ended")


def ended_children_cpu_s() -> float:
    """User and system time of all descendants that have ended and were waited for."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Watch:
    """Remembers the last seen usage of the descendants of a process."""

    def __init__(self, root: int) -> None:
        self._root = root
        self.seen: dict[int, Usage] = {}

    def look(self) -> None:
        """Looks at all that live now; what a process uses between the last look and its end is missed."""
        for pid in _descendants(self._root):
            usage = _usage(pid)
            if usage is not None:
                self.seen[pid] = usage


def _usage(pid: int) -> Usage | None:
    """None where the process has ended meanwhile."""
    folder = Path(f"/proc/{pid}")
    try:
        command = folder.joinpath("cmdline").read_bytes().decode(errors="replace").replace("\0", " ").strip()
        fields = folder.joinpath("stat").read_text().rpartition(")")[2].split()
        cpu = (int(fields[11]) + int(fields[12])) * _TICK_S
        return Usage(command, cpu, peak_memory_mb(pid))
    except (OSError, ProcessLookupError):
        return None


def _descendants(root: int) -> list[int]:
    found = [root]
    for pid in found:
        try:
            children = [
                child
                for task in Path(f"/proc/{pid}/task").iterdir()
                for child in task.joinpath("children").read_text().split()
            ]
        except OSError:
            continue
        found += map(int, children)
    return found
