#!/usr/bin/env python3
"""Runs evac and its peers on the same recorded walks, one after the other, and judges all by the same figures."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import environment

SYSTEMS = ("evac", "genz-lio", "rko-lio", "kiss-icp")


def main() -> None:
    """See `--help`."""
    options = _options()
    if options.self_check:
        import selfcheck

        selfcheck.main(options.evac)
        return
    if not environment.inside():
        environment.enter()
    # These need numpy, which only the environment is sure to have.
    import bench
    import report
    import walks

    output = options.output.resolve()
    evac = _evac(options.evac)
    chosen = walks.given_by(options.walk, output) if options.walk else walks.default(evac, output)
    if not chosen:
        sys.exit("there is no walk to run on")
    results = []
    for walk in chosen:
        for system in options.peer or SYSTEMS:
            result = bench.run(system, walk, evac, output / "runs" / walk.name / system, options.timeout)
            print(report.line(result), file=sys.stderr, flush=True)
            results.append(result)
    text = report.write(results, output, bench.machine(), bench.versions(evac))
    print(text)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add(
        "--walk",
        metavar="DIR",
        type=Path,
        action="append",
        help="a recorded walk, instead of the usual ones (repeatable)",
    )
    add(
        "--peer",
        metavar="NAME",
        choices=SYSTEMS,
        action="append",
        help=f"only these of {', '.join(SYSTEMS)} (repeatable)",
    )
    default = environment.REPOSITORY / "target" / "release" / "evac"
    add("--evac", metavar="PATH", type=Path, help=f"evac's executable [{default}, built where it is missing]")
    add("-o", "--output", metavar="DIR", type=Path, default=environment.REPOSITORY / "target" / "peers")
    add("--timeout", metavar="SECONDS", type=float, default=900.0, help="for one system on one walk [900]")
    add("--self-check", action="store_true", help="check readers and figures, without the peers")
    return parser.parse_args()


def _evac(given: Path | None) -> Path:
    if given is not None:
        return given.resolve()
    built = environment.REPOSITORY / "target" / "release" / "evac"
    if not built.exists():
        command = ["cargo", "build", "--release", "--locked", "--bin", "evac"]
        subprocess.run(command, cwd=environment.REPOSITORY, check=True)
    return built


if __name__ == "__main__":
    main()
