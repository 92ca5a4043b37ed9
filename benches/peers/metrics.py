"""How far a trajectory is from the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recording.trajectory import Trajectory, at, rotations

_EDGE_NS = 1_000_000
"""A system that stamps a pose with its frame's last point is a few shots before the truth begins: that much the truth
is extrapolated."""

SETTLED_NS = 2_000_000_000
"""From the start of the truth until a filter should have settled; in the usual walks the walker still stands."""


@dataclass(frozen=True)
class End:
    """Error of the last pose after an earlier one is laid on its true one."""

    metres: float
    percent: float
    """Of the true path between them."""
    degrees: float


@dataclass(frozen=True)
class Accuracy:
    """The same figures as evac's own `summary.json`, and the spread of the height error."""

    frames: int
    """Poses compared."""
    path_m: float
    """Length of the true path between the first and the last of them."""
    ape_rmse_m: float
    """Absolute position error, root mean square, after the best rigid alignment (Umeyama 1991, no scale)."""
    ape_max_m: float
    """The largest of these errors."""
    end: End
    """From the first pose on."""
    settled_end: End
    """From the first pose at or after `SETTLED_NS` on."""
    z_std_m: float
    """Standard deviation of the height error after the best rigid alignment."""


def accuracy(truth: Trajectory, estimate: Trajectory) -> Accuracy:
    """Compares at the estimate's stamps; the truth is interpolated to them.

    Both are on one clock and of the LiDAR. Raises ValueError where fewer than three poses can be compared, or a pose is
    not finite.
    """
    first, last = truth.times_ns[0] - _EDGE_NS, truth.times_ns[-1] + _EDGE_NS
    inside = (estimate.times_ns >= first) & (estimate.times_ns <= last)
    if np.count_nonzero(inside) < 3:
        raise ValueError(f"{np.count_nonzero(inside)} of {len(estimate)} poses are within the time of the truth")
    estimate = Trajectory(estimate.times_ns[inside], estimate.positions[inside], estimate.quaternions[inside])
    if not (np.isfinite(estimate.positions).all() and np.isfinite(estimate.quaternions).all()):
        raise ValueError("a pose is not finite")
    truth = at(truth, estimate.times_ns)
    errors = align(estimate.positions, truth.positions) - truth.positions
    distances = np.linalg.norm(errors, axis=1)
    settled = int(np.searchsorted(truth.times_ns, first + SETTLED_NS))
    return Accuracy(
        frames=len(estimate),
        path_m=_path(truth, 0),
        ape_rmse_m=float(np.sqrt(np.mean(distances**2))),
        ape_max_m=float(distances.max()),
        end=_end(truth, estimate, 0),
        settled_end=_end(truth, estimate, min(settled, len(estimate) - 2)),
        z_std_m=float(errors[:, 2].std()),
    )


def align(points: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """`points` after the rigid transform that lays them best on `reference`; both (N, 3)."""
    mean, reference_mean = points.mean(axis=0), reference.mean(axis=0)
    u, _, vt = np.linalg.svd((reference - reference_mean).T @ (points - mean))
    rotation = u @ np.diag([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))]) @ vt
    return (points - mean) @ rotation.T + reference_mean


def _path(trajectory: Trajectory, start: int) -> float:
    """Length from a pose on."""
    return float(np.linalg.norm(np.diff(trajectory.positions[start:], axis=0), axis=1).sum())


def _end(truth: Trajectory, estimate: Trajectory, start: int) -> End:
    """Error of the last pose relative to the one numbered `start`."""

    def relative(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray]:
        first, last = rotations(trajectory.quaternions[[start, -1]])
        return first.T @ (trajectory.positions[-1] - trajectory.positions[start]), first.T @ last

    (true_shift, true_turn), (shift, turn) = relative(truth), relative(estimate)
    error = true_turn.T @ turn
    # From the skew part too: the cosine alone does not see angles below 1e-6 degrees.
    sine = np.linalg.norm([error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]]) / 2
    angle = np.arctan2(sine, (np.trace(error) - 1) / 2)
    metres, path = float(np.linalg.norm(shift - true_shift)), _path(truth, start)
    return End(metres, 100 * metres / path if path > 0 else 0.0, float(np.degrees(angle)))
