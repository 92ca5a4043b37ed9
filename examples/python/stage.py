#!/usr/bin/env python3
"""A deskewer's stand-in: one point a voxel, within the configured ranges; the motion stays in the scan.

    evac swap deskewer --run target/python-venv/bin/python examples/python/stage.py --voxel 0.05
"""

import numpy as np

from evac_stage import options_of, run_scan_stage

parser = options_of("deskewer")
parser.add_argument("--voxel", type=float, default=0.02, metavar="METRES", help="one point is kept in each such cube")
options = parser.parse_args()


def thin(header, points, config):
    """Of the points within range, the first in each voxel, in their order."""
    squared = points["x"] ** 2 + points["y"] ** 2 + points["z"] ** 2
    nearest, farthest = max(config.get("min_range_m", 0.3), 1e-6), config.get("max_range_m", 260.0)
    # No return is the origin, and nothing that is not finite compares as true.
    kept = np.flatnonzero((squared >= nearest**2) & (squared <= farthest**2))
    header.no_return = int(np.count_nonzero(squared == 0.0))
    header.rejected += len(points) - header.no_return - len(kept)

    cell = [np.floor(points[axis][kept] / options.voxel).astype(np.int64) & 0x1FFFFF for axis in "xyz"]
    _, first = np.unique(cell[0] << 42 | cell[1] << 21 | cell[2], return_index=True)
    return points[kept[np.sort(first)]]


run_scan_stage(options, thin)
