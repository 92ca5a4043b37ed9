"""The tables and the JSON file."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

from bench import Result
from metrics import End

_COLUMNS = (
    "walk",
    "system",
    "poses",
    "APE rms / max, m",
    "end, m (%)",
    "end, deg",
    "end from 2 s, m (%)",
    "end from 2 s, deg",
    "z std, m",
    "CPU, ms/frame",
    "time p50 / p99, ms",
    "memory, MB",
)


def write(results: list[Result], output: Path, machine: dict[str, Any], versions: dict[str, str]) -> str:
    """Writes peers.md and peers.json; returns the former's text."""
    names = ", ".join(f"{name} {version}" for name, version in versions.items())
    load = machine["load_average_at_end"][1]
    parts = [
        f"{names}.\n\n{machine['cores']} cores of {machine['processor']}, {machine['system']}, "
        f"load average of the last five minutes {load:.1f}.",
        _table(["system", *_SUMMARY], _summary(results)),
        _table(_COLUMNS, [_cells(result) for result in results]),
        *_pipeline(results),
    ]
    text = "\n\n".join(parts) + "\n"
    (output / "peers.md").write_text(text)
    content = {"machine": machine, "versions": versions, "results": [asdict(result) for result in results]}
    (output / "peers.json").write_text(json.dumps(content, indent=2) + "\n")
    return text


def line(result: Result) -> str:
    """One result, for somebody who waits."""
    return " | ".join(_cells(result))


_SUMMARY = (
    "walks",
    "APE rms median / worst, m",
    "end from 2 s median, %",
    "CPU median, ms/frame",
    "memory most, MB",
)


def _summary(results: list[Result]) -> list[list[str]]:
    rows = []
    for system in dict.fromkeys(result.system for result in results):
        own = [result for result in results if result.system == system]
        done = [result for result in own if result.accuracy is not None]
        row = [system, f"{len(done)}/{len(own)}"]
        if done:
            ape = [result.accuracy.ape_rmse_m for result in done if result.accuracy]
            end = [result.accuracy.settled_end.percent for result in done if result.accuracy]
            cpu = [result.figures["cpu_ms_mean"] for result in done]
            memory = [result.figures["memory_mb"] for result in done]
            row += [
                f"{median(ape):.3f} / {max(ape):.3f}",
                f"{median(end):.2f}",
                f"{median(cpu):.1f}",
                f"{max(memory):.0f}",
            ]
        rows.append(row)
    return rows


def _cells(result: Result) -> list[str]:
    cells = [result.walk, result.system]
    accuracy, figures = result.accuracy, result.figures
    if accuracy is None:
        cells += [result.failure or "failed"]
    if accuracy is not None:
        cells += [
            f"{accuracy.frames}/{figures['frames']}",
            f"{accuracy.ape_rmse_m:.3f} / {accuracy.ape_max_m:.3f}",
            *_end(accuracy.end),
            *_end(accuracy.settled_end),
            f"{accuracy.z_std_m:.3f}",
            f"{figures['cpu_ms_mean']:.1f}",
            f"{figures['wall_ms_p50']:.1f} / {figures['wall_ms_p99']:.1f}",
            f"{figures['memory_mb']:.0f}",
        ]
    return cells


def _end(end: End) -> list[str]:
    return [f"{end.metres:.3f} ({end.percent:.2f})", f"{end.degrees:.2f}"]


def _pipeline(results: list[Result]) -> list[str]:
    """What evac's other stages cost, where it ran."""
    whole = [result.figures for result in results if "pipeline_cpu_ms_mean" in result.figures]
    if not whole:
        return []
    cpu = median(figures["pipeline_cpu_ms_mean"] for figures in whole)
    memory = max(figures["pipeline_memory_mb"] for figures in whole)
    return [
        "evac's rows are its deskewer and odometry. All of its processes, which also read the recording and make the "
        f"maps, take {cpu:.1f} ms CPU a frame (median) and {memory:.0f} MB (most; shared memory is counted in each)."
    ]


def _table(columns: Any, rows: list[list[str]]) -> str:
    width = len(columns)
    filled = [row + [""] * (width - len(row)) for row in rows]
    lines = [list(columns), ["---"] * width, *filled]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |" for cells in lines)
