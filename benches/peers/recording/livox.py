"""Frames of a Mid-40 out of a capture of its UDP packets (Livox SDK1, data type 0)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .pcap import udp_payloads

PERIOD_NS = 100_000_000
"""Length of a frame."""
SHOT_NS = 10_000
"""A Mid-40 shoots 100,000 times a second; a packet has the time of its first shot."""

_HEADER = struct.Struct("<BBBBIBBQ")
_VERSION = 5
_CARTESIAN = 0
_SHOT = np.dtype([("mm", "<i4", (3,)), ("reflectivity", "u1")])


@dataclass(frozen=True)
class Frame:
    """What one sweep of 100 ms has measured. Shots without a return are left out."""

    start_ns: int
    """Begin of the sweep; it ends `PERIOD_NS` later, which is no longer part of it."""
    points: np.ndarray
    """(N, 3), metres, LiDAR frame: x forward, y left, z up."""
    times_ns: np.ndarray
    """(N,), time of each point."""
    shots: int
    """Laser shots, with and without a return."""

    @property
    def end_ns(self) -> int:
        """End of the sweep."""
        return self.start_ns + PERIOD_NS


def first_stamp_ns(path: Path) -> int:
    """Time of the first shot."""
    for stamp, _ in _packets(path):
        return stamp
    raise ValueError(f"{path} has no packet of a Mid-40")


def frames(path: Path) -> Iterator[Frame]:
    """Yields frame k with the shots of [t0 + k P, t0 + (k + 1) P), t0 being the time of the first shot.

    This is how evac divides a capture; a last sweep of less than half a period is left out by both.
    """
    held: list[tuple[int, np.ndarray]] = []
    start = None
    for stamp, shots in _packets(path):
        start = stamp if start is None else start
        while stamp >= start + PERIOD_NS:
            yield _frame(start, held)
            held = []
            start += PERIOD_NS
        inside = -(-(start + PERIOD_NS - stamp) // SHOT_NS)
        held.append((stamp, shots[:inside]))
        if inside < len(shots):
            yield _frame(start, held)
            held = [(stamp + inside * SHOT_NS, shots[inside:])]
            start += PERIOD_NS
    if start is not None and held:
        last, shots = held[-1]
        if 2 * (last + len(shots) * SHOT_NS - start) >= PERIOD_NS:
            yield _frame(start, held)


def _packets(path: Path) -> Iterator[tuple[int, np.ndarray]]:
    """Time of the first shot and shots of every data packet."""
    for payload in udp_payloads(path):
        if len(payload) < _HEADER.size or payload[0] != _VERSION:
            continue
        _, _, _, _, _, clock, kind, stamp = _HEADER.unpack_from(payload)
        if kind != _CARTESIAN or clock not in (0, 1):
            raise ValueError(f"{path}: data type {kind} with clock {clock}; only a Mid-40's type 0 is read here")
        yield stamp, np.frombuffer(payload, _SHOT, offset=_HEADER.size)


def _frame(start: int, held: list[tuple[int, np.ndarray]]) -> Frame:
    if not held:
        return Frame(start, np.empty((0, 3)), np.empty(0, np.int64), 0)
    shots = np.concatenate([shots for _, shots in held])
    times = np.concatenate([stamp + SHOT_NS * np.arange(len(shots), dtype=np.int64) for stamp, shots in held])
    returned = shots["mm"].any(axis=1)
    return Frame(start, shots["mm"][returned] * 1e-3, times[returned], len(shots))
