#!/usr/bin/env python3
"""Sends scans to a stage at 10 Hz and says how it keeps up; no launcher and no robot needed.

    target/python-venv/bin/python examples/python/measure.py --seconds 30
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from evac_stage import Bus, Publisher, Subscriber, now_ns, structure

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--seconds", type=float, default=30.0)
parser.add_argument("--points", type=int, default=24_000)
parser.add_argument("--hz", type=float, default=10.0)
parser.add_argument("stage", nargs="*", default=[str(Path(__file__).parent / "stage.py")], help="script and its options")
options = parser.parse_args()

domain = f"measure-{os.getpid()}"
bus = Bus(domain, "measure")
scans, output, health = Publisher(bus, "lidar/scan"), Subscriber(bus, "scan/deskewed"), Subscriber(bus, "health/status")
stage = subprocess.Popen([sys.executable, *options.stage, "--domain", domain])
while next(health.records(), None) is None:
    bus.wait(1.0)
    if stage.poll() is not None:
        sys.exit("the stage has ended")

# Walls 2 to 10 m away, other ones in each scan.
points = np.zeros(options.points, dtype=np.dtype(structure("evac.Point.v1")))
random = np.random.default_rng(1)
header = structure("evac.ScanHeader.v2")()
sent = int(options.seconds * options.hz)
period_ns, start_ns = int(1e9 / options.hz), now_ns()
latencies, seqs, received_points = [], [], 0


def take():
    global received_points
    while (frame := output.receive()) is not None:
        latencies.append((now_ns() - frame.header.frame.arrival_ns) * 1e-6)
        seqs.append(frame.seq)
        received_points += len(frame.items)
        frame.close()


for seq in range(sent):
    for axis in "xyz":
        points[axis] = random.uniform(2.0, 10.0, options.points)
    while (left := start_ns + seq * period_ns - now_ns()) > 0 and not bus.wait(left * 1e-9):
        take()
    frame = header.frame
    frame.seq, frame.start_ns, frame.end_ns = seq, seq * period_ns, (seq + 1) * period_ns
    header.points, frame.arrival_ns = options.points, now_ns()

    def stamped():
        frame.sent_ns = now_ns()
        return header

    scans.publish_frame(stamped, points)
until = time.monotonic() + 5.0
while len(seqs) < sent and time.monotonic() < until:
    bus.wait(0.1)
    take()
report = list(health.records())[-1]
stage.terminate()
stage.wait()
in_order = seqs == sorted(set(seqs))
p50, p99, worst = (np.percentile(latencies, q, method="higher") for q in (50, 99, 100))
print(f"{sent} scans of {options.points} points at {options.hz:g} Hz: {len(seqs)} came back, {sent - len(set(seqs))} lost, "
      f"{'in order' if in_order else 'OUT OF ORDER'}; {received_points / max(len(seqs), 1):.0f} points a scan left")
print(f"from sent to received, ms: p50 {p50:.2f}, p99 {p99:.2f}, max {worst:.2f}; computing p50 "
      f"{report.compute.p50_ns * 1e-6:.2f}, p99 {report.compute.p99_ns * 1e-6:.2f}; load {os.getloadavg()[0]:.1f}")
prefix = f"evac-{os.getuid()}-{domain}_"
del scans, output, health
folder = bus.folder
del bus
for left in Path("/dev/shm").glob(prefix + "*"):
    left.unlink(missing_ok=True)
shutil.rmtree(folder, ignore_errors=True)
sys.exit(0 if len(seqs) == sent and in_order else 1)
