"""Makes truth.tum, estimate.tum and evo.json: a noisy walk and what evo says of it.

    pip install evo==1.38.1 && python make.py
"""

import json

import numpy as np
from evo import __version__
from evo.core import metrics
from evo.core.units import Unit
from evo.tools import file_interface
from scipy.spatial.transform import Rotation

FRAMES = 160
rng = np.random.default_rng(7)


def write(name, positions, rotations):
    with open(name, "w") as file:
        for i, (p, q) in enumerate(zip(positions, rotations.as_quat())):
            numbers = " ".join(f"{v:.9f}" for v in [*p, *q])
            file.write(f"{1700000000 + i * 0.1:.9f} {numbers}\n")


# A walk of 0.9 m/s round a corner, with a stop of 1.5 s and the sway of steps.
t = np.arange(FRAMES) * 0.1
speed = np.where((t > 6) & (t < 7.5), 0.0, 0.9)
yaw = 0.4 + np.interp(t, [4, 6, 9, 11], [0, 1.5, 1.5, 2.6])
velocity = speed[:, None] * np.c_[np.cos(yaw), np.sin(yaw), 0.05 * np.ones(FRAMES)]
truth = np.cumsum(velocity * 0.1, axis=0) + [2.0, -3.0, 1.2]
truth[:, 2] += 0.03 * np.sin(2 * np.pi * 1.8 * t) * (speed > 0)
truth_rotation = Rotation.from_euler("zyx", np.c_[yaw, 0.05 * np.sin(7 * t), 0.04 * np.cos(5 * t)])

# The estimate drifts, is noisy, and has a map frame of its own.
drift = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.002, (FRAMES, 3)), axis=0))
moved = np.cumsum(drift.apply(np.diff(truth, axis=0, prepend=truth[:1])), axis=0)
moved += rng.normal(0, 0.004, moved.shape)
frame = Rotation.from_euler("zyx", [2.0, 0.1, -0.2])
write("truth.tum", truth, truth_rotation)
write("estimate.tum", frame.apply(moved) + [5.0, 1.0, -2.0], frame * drift * truth_rotation)

truth = file_interface.read_tum_trajectory_file("truth.tum")
figures = {"evo": __version__}


def compare(name, metric, estimate):
    metric.process_data((truth, estimate))
    figures[name] = {k: float(v) for k, v in metric.get_all_statistics().items()} | {"pairs": len(metric.error)}


position, angle = metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_deg
for name, align in [
    ("se3", lambda estimate: estimate.align(truth, correct_scale=False)),
    ("first", lambda estimate: estimate.align_origin(truth)),
]:
    estimate = file_interface.read_tum_trajectory_file("estimate.tum")
    align(estimate)
    compare(f"ape_{name}", metrics.APE(position), estimate)
    compare(f"rotation_{name}_deg", metrics.APE(angle), estimate)
for relation, part in [(position, "translation_m"), (angle, "rotation_deg")]:
    compare(f"rpe_1s_{part}", metrics.RPE(relation, 10, Unit.frames, all_pairs=True), estimate)
    by_path = metrics.RPE(relation, 1.0, Unit.meters, 0.1, all_pairs=True, pairs_from_reference=True)
    compare(f"rpe_1m_{part}", by_path, estimate)
with open("evo.json", "w") as file:
    json.dump(figures, file, indent=1)
    file.write("\n")
