#!/usr/bin/env python3
"""Checks the readers and the figures without installing a peer: `selfcheck.py [--evac PATH]`.

With evac's executable also against what evac itself says of a recording that it makes for this.
"""

from __future__ import annotations

import argparse
import json
import os
import struct
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import environment

try:
    import numpy as np
except ModuleNotFoundError:
    if environment.PYTHON.exists() and not environment.inside():
        os.execv(str(environment.PYTHON), [str(environment.PYTHON), *sys.argv])
    print("skipped: the self-check of benches/peers needs numpy")
    sys.exit(0)

import metrics
import ours
from recording import livox, rig, trajectory, wt901c
from recording.walk import Walk

_SEED = 7


def main(evac: Path | None) -> None:
    """Runs all checks; the first that does not hold ends the program."""
    a_packet_across_a_border_is_divided_between_its_frames()
    damaged_bytes_cost_one_imu_sample_and_shift_no_time()
    a_rig_file_gives_the_transform_that_evac_documents()
    a_trajectory_survives_its_file_and_turns_along_the_shortest_arc()
    a_turned_and_shifted_copy_has_no_error_and_a_bent_end_its_own()
    evo_gives_the_same_absolute_error()
    if evac is None:
        print("skipped: no evac executable to compare with (--evac PATH)")
    else:
        evac_sees_the_same_frames_samples_and_drift(evac.resolve())
    print("self-check of benches/peers: all holds")


def a_packet_across_a_border_is_divided_between_its_frames() -> None:
    """Frame k ends where frame k + 1 begins; shots without a return keep their time but are no points."""
    ramp = [(i, 1, -1) for i in range(100)]
    packets = [(0, [(1000, 0, -500), (0, 0, 0)]), (99_500_000, ramp), (160_000_000, ramp)]
    with tempfile.TemporaryDirectory() as folder:
        capture = Path(folder) / "lidar.pcap"
        capture.write_bytes(_capture(packets))
        first, second = livox.frames(capture)
    assert (first.start_ns, first.end_ns, first.shots, len(first.points)) == (0, 100_000_000, 52, 51)
    assert np.array_equal(first.points[0], [1.0, 0.0, -0.5])
    assert (first.times_ns[0], first.times_ns[1], first.times_ns[-1]) == (0, 99_500_000, 99_990_000)
    assert (second.start_ns, second.shots, second.times_ns[0]) == (100_000_000, 150, 100_000_000)
    assert np.allclose(second.points[0], [0.050, 0.001, -0.001])


def damaged_bytes_cost_one_imu_sample_and_shift_no_time() -> None:
    """The numbers are the manual's: one g is 2048 units, 1000 deg/s are 16384."""
    log = b"".join(_imu_frame(0x51, (2048, -4096, k)) + _imu_frame(0x52, (16384, 0, 0)) for k in range(5))
    damaged = log[:25] + b"\0" + log[26:]
    samples = wt901c.parse(damaged, start_ns=1_000)
    assert list(samples.times_ns) == [1_000, 10_001_000, 15_001_000, 20_001_000]
    assert np.allclose(samples.accel[0, :2], [9.80665, -19.6133])
    assert np.allclose(samples.gyro[0], [np.radians(1000), 0, 0])
    assert np.allclose(samples.accel[1, 2], 2 * 9.80665 / 2048)


def a_rig_file_gives_the_transform_that_evac_documents() -> None:
    """R = Rz Ry Rx takes LiDAR to IMU coordinates."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rig.toml"
        file.write_text(
            "[rig.imu_from_lidar] # a comment\ntranslation_m = [0.1, 0, 0]\nroll_pitch_yaw_deg = [0, 0, 90]\n"
        )
        turned = rig.read_toml(file).imu_from_lidar @ [1, 0, 0, 1]
        assert np.allclose(turned, [0.1, 1, 0, 1])
        general = rig.Rig((1, 2, 3), (10, 20, 30))
        file.write_text(general.toml())
        assert rig.read_toml(file) == general
    # Ry(20) takes x to (cos, 0, -sin); Rz(30) turns that about z.
    expected = [
        np.cos(np.radians(20)) * np.cos(np.radians(30)),
        np.cos(np.radians(20)) / 2,
        -np.sin(np.radians(20)),
    ]
    assert np.allclose(general.imu_from_lidar[:3, 0], expected)


def a_trajectory_survives_its_file_and_turns_along_the_shortest_arc() -> None:
    """Stamps from the epoch on keep every nanosecond."""
    quarter = np.sqrt(0.5)
    start = 1_700_000_000_123_456_789
    poses = trajectory.Trajectory(
        np.array([start, start + 100]),
        np.array([[0.0, 0, 0], [1, 2, 3]]),
        np.array([[0, 0, 0, 1], [0, 0, -quarter, -quarter]]),
    )
    with tempfile.TemporaryDirectory() as folder:
        trajectory.write_tum(Path(folder) / "a.tum", poses)
        read = trajectory.read_tum(Path(folder) / "a.tum")
    assert np.array_equal(read.times_ns, poses.times_ns)
    assert np.allclose(read.positions, poses.positions) and np.allclose(read.quaternions, poses.quaternions)
    middle = trajectory.at(read, np.array([start + 50]))
    half = np.radians(22.5)
    assert np.allclose(middle.positions, [[0.5, 1, 1.5]])
    assert np.allclose(np.abs(middle.quaternions), [[0, 0, np.sin(half), np.cos(half)]])
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[:, :3, :3] = trajectory.rotations(read.quaternions)
    back = trajectory.from_matrices([0, 1], list(matrices)).quaternions
    assert np.allclose(trajectory.rotations(back), matrices[:, :3, :3])


def a_turned_and_shifted_copy_has_no_error_and_a_bent_end_its_own() -> None:
    """The figures do not depend on where a system puts its origin."""
    truth, copy = _walk_and_copy()
    none = metrics.accuracy(truth, copy)
    assert none.frames == len(truth) and none.ape_max_m < 1e-9 and none.z_std_m < 1e-9, none
    assert max(none.end.metres, none.end.degrees, none.settled_end.metres, none.settled_end.degrees) < 1e-6, none
    copy.positions[-1] += 0.4 * copy.positions[0] / np.linalg.norm(copy.positions[0])
    bent = metrics.accuracy(truth, copy)
    assert abs(bent.end.metres - 0.4) < 1e-9 and abs(bent.end.percent - 40 / bent.path_m) < 1e-9, bent
    assert 0.3 < bent.ape_max_m < 0.4, bent
    # Half the poses 0.1 m too high, which no rigid transform takes back because they alternate.
    truth, copy = _walk_and_copy(turn=0.0)
    copy.positions[::2, 2] += 0.1
    assert abs(metrics.accuracy(truth, copy).z_std_m - 0.05) < 1e-3


def evo_gives_the_same_absolute_error() -> None:
    """An independent implementation, where it is installed (`pip install evo`)."""
    try:
        from evo.core import metrics as evo_metrics
        from evo.core.trajectory import PoseTrajectory3D
    except ModuleNotFoundError:
        print("skipped: evo is not installed")
        return
    truth, copy = _walk_and_copy()
    copy.positions[:] += np.random.default_rng(_SEED).normal(size=copy.positions.shape)

    def theirs(poses: trajectory.Trajectory) -> PoseTrajectory3D:
        return PoseTrajectory3D(poses.positions, poses.quaternions[:, [3, 0, 1, 2]], poses.times_ns * 1e-9)

    reference, estimate = theirs(truth), theirs(copy)
    estimate.align(reference)
    error = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    error.process_data((reference, estimate))
    expected = error.get_statistic(evo_metrics.StatisticsType.rmse)
    assert abs(metrics.accuracy(truth, copy).ape_rmse_m - expected) < 1e-9, expected


def evac_sees_the_same_frames_samples_and_drift(evac: Path) -> None:
    """evac walks, records and maps four seconds; readers and figures here must agree with its own."""
    with tempfile.TemporaryDirectory() as folder:
        walk, output = Walk("selfcheck", Path(folder) / "walk"), Path(folder) / "map"
        ours.record(evac, "corridor", _SEED, walk.folder, Path(folder) / "demo", duration_s=4)
        output.mkdir()
        ours.run(evac, walk, output, timeout_s=120, extra=["--truth", str(walk.truth)])
        summary = json.loads((output / "summary.json").read_text())
        estimate = trajectory.read_tum(output / "trajectory.tum")
        frames = list(livox.frames(walk.lidar))
        assert len(frames) == summary["frames"] == 40
        assert [frame.end_ns for frame in frames] == list(estimate.times_ns)
        assert {frame.shots for frame in frames} == {10_000}
        samples = walk.imu_samples()
        assert len(samples) == 801 and samples.times_ns[-1] == frames[-1].end_ns
        assert abs(np.linalg.norm(samples.accel[:200].mean(axis=0)) - 9.80665) < 0.2
        accuracy, drift = metrics.accuracy(walk.true_trajectory(), estimate), summary["drift"]
        pairs = [
            (accuracy.ape_rmse_m, drift["ape_rmse_m"]),
            (accuracy.ape_max_m, drift["ape_max_m"]),
            (accuracy.end.metres, drift["end_m"]),
            (accuracy.end.degrees, drift["end_rotation_deg"]),
            (accuracy.path_m, drift["path_m"]),
        ]
        # Both read the same nine decimals, and align and interpolate each in its own way.
        assert all(abs(a - b) < 1e-6 for a, b in pairs), pairs


def _walk_and_copy(turn: float = 1.5) -> tuple[trajectory.Trajectory, trajectory.Trajectory]:
    """Ten seconds along a bend, and the same seen from another frame."""
    seconds = np.arange(0.1, 10, 0.1)
    matrices = []
    for t in seconds:
        matrix = np.eye(4)
        matrix[:2, :2] = [[np.cos(0.1 * t), -np.sin(0.1 * t)], [np.sin(0.1 * t), np.cos(0.1 * t)]]
        matrix[:3, 3] = [5 * np.sin(0.3 * t), 4 * np.cos(0.2 * t), 0.1 * t]
        matrices.append(matrix)
    other = rig.Rig((5.0, -2.0, 1.0), (0.0, 10.0 * turn, 60.0 * turn)).imu_from_lidar
    times = [round(1e9 * t) for t in seconds]
    copies = [other @ matrix for matrix in matrices]
    return trajectory.from_matrices(times, matrices), trajectory.from_matrices(times, copies)


def _capture(packets: Iterable[tuple[int, list[tuple[int, int, int]]]]) -> bytes:
    """A pcap file with one datagram for each (time in ns, shots in mm)."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)]
    for stamp, shots in packets:
        payload = struct.pack("<BBBBIBBQ", 5, 1, 1, 0, 0, 0, 0, stamp)
        payload += b"".join(struct.pack("<iiiB", *shot, 10) for shot in shots)
        udp = struct.pack(">HHHH", 65000, 56001, 8 + len(payload), 0) + payload
        ip = struct.pack(
            ">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, b"\xc0\xa8\x01\x0b", b"\xc0\xa8\x01\x32"
        )
        packet = bytes(12) + b"\x08\x00" + ip + udp
        parts.append(struct.pack("<IIII", 0, 0, len(packet), len(packet)) + packet)
    return b"".join(parts)


def _imu_frame(kind: int, words: tuple[int, int, int]) -> bytes:
    frame = struct.pack("<BBhhhh", 0x55, kind, *words, 0)
    return frame + bytes([sum(frame) & 0xFF])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--evac", metavar="PATH", type=Path, help="evac's executable, to compare with")
    main(parser.parse_args().evac)
