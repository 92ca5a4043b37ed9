#!/usr/bin/env python3
"""One-way hop of a frame between two processes: evac's services beside Zenoh's shared memory, in turn, in one run.

    benches/zenoh/setup && target/zenoh-venv/bin/python benches/zenoh/hop.py

Both transports are the compiled libraries under their makers' own Python packages. A ping-pong, halved: what is timed is from
handing over a frame that lies in shared memory to having it in the other process, where nobody reads it. The moments travel in
the frame's header (evac) or as an attachment (Zenoh). Zenoh: two peers over a Unix socket, shared memory on, and every
received payload is checked to be shared memory.
"""

import argparse
import ctypes
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import zenoh
from zenoh.shm import BlockOn, GarbageCollect, ShmProvider

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "python"))
from evac_stage import Bus, Publisher, Subscriber, now_ns, structure  # noqa: E402

POINT = np.dtype(structure("evac.Point.v1"))
# Points: 1 KiB, 64 KiB, 384 KiB.
SIZES = [64, 4096, 24576]
WARM_UP = 50
PATIENCE_S = 60


class Evac:
    """Frames as the stages send them, there as lidar/scan and back as scan/deskewed."""

    name = "evac (iceoryx2)"

    def __init__(self, domain, is_peer):
        there, back = ("lidar/scan", "scan/deskewed")[:: -1 if is_peer else 1]
        self._bus = Bus(domain, "peer" if is_peer else "bench")
        self._input, self._output = Subscriber(self._bus, back), Publisher(self._bus, there)
        self._header = structure("evac.ScanHeader.v2")()
        self._points = {size: np.zeros(size, POINT) for size in SIZES}

    def send(self, size, received_ns):
        """Hands over a frame of so many points; gives when."""
        frame = self._header.frame
        frame.arrival_ns = received_ns

        def stamped():
            frame.sent_ns = now_ns()
            return self._header

        self._output.publish_frame(stamped, self._points[size])
        return frame.sent_ns

    def receive(self):
        """Waits for a frame: when it was there, what its sender had received when, when it was sent, and its points."""
        while (frame := self._input.receive()) is None:
            if self._bus.wait(1.0):
                sys.exit(0)
        stamps = frame.header.frame
        result = frame.received_ns, stamps.arrival_ns, stamps.sent_ns, len(frame.items)
        frame.close()
        return result


class Zenoh:
    """Zenoh in shared memory."""

    name = "zenoh shared memory"

    def __init__(self, folder, is_peer):
        config, endpoint = zenoh.Config(), f'["unixsock-stream/{folder}/zenoh.sock"]'
        config.insert_json5("mode", '"peer"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/shared_memory/enabled", "true")
        config.insert_json5("connect/endpoints" if is_peer else "listen/endpoints", endpoint)
        if is_peer:
            config.insert_json5("listen/endpoints", "[]")
        self._session = zenoh.open(config)
        self._bytes = {size: bytes(size * POINT.itemsize) for size in SIZES}
        self._provider = ShmProvider.default_backend(64 << 20)
        there, back = ("bench/there", "bench/back")[:: -1 if is_peer else 1]
        self._input = self._session.declare_subscriber(back)
        self._output = self._session.declare_publisher(
            there, congestion_control=zenoh.CongestionControl.BLOCK, express=True)

    def send(self, size, received_ns):
        """As above."""
        buffer = self._provider.alloc(size * POINT.itemsize, policy=BlockOn(GarbageCollect()))
        buffer[0 : size * POINT.itemsize] = self._bytes[size]
        sent_ns = now_ns()
        self._output.put(buffer, attachment=struct.pack("<qq", received_ns, sent_ns))
        return sent_ns

    def receive(self):
        """As above."""
        sample = self._input.recv()
        memory, now = sample.payload.as_shm(), now_ns()
        if memory is None:
            sys.exit("zenoh has sent bytes instead of shared memory")
        return now, *struct.unpack("<qq", bytes(sample.attachment)), len(sample.payload) // POINT.itemsize


def serve(transport):
    """Answers every frame with one of the same length."""
    print("ready", flush=True)
    while True:
        now, _, _, size = transport.receive()
        transport.send(size, now)


def measure(transport, size, count):
    """One-way times, microseconds."""
    signal.alarm(PATIENCE_S)  # ends the bench where a frame does not come
    times = []
    for _ in range(count):
        sent_ns = transport.send(size, 0)
        now, peer_received_ns, peer_sent_ns, points = transport.receive()
        assert points == size, f"{points} of {size} points came"
        times.append(((peer_received_ns - sent_ns) + (now - peer_sent_ns)) / 2000)
    return times


def main():
    """Measures, or answers as a peer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000, help="round trips of each size and transport")
    parser.add_argument("--peer", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peer:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # not to outlive the bench
        kind, place = options.peer
        serve(Evac(place, True) if kind == "evac" else Zenoh(place, True))
    domain, folder = f"zenoh-bench-{os.getpid()}", tempfile.mkdtemp()
    before = set(Path("/dev/shm").glob("*.zenoh"))
    transports, peers = [Evac(domain, False), Zenoh(folder, False)], []
    for kind, place in (("evac", domain), ("zenoh", folder)):
        peer = subprocess.Popen([sys.executable, __file__, "--peer", kind, place], stdout=subprocess.PIPE, text=True)
        assert peer.stdout.readline() == "ready\n", f"the peer of {kind} did not get ready"
        peers.append(peer)
    times = {}
    try:
        for size in SIZES:
            for transport in transports:
                measure(transport, size, WARM_UP)
            # In turn, so that whatever else the machine does is on both.
            for _ in range(10):
                for transport in transports:
                    times.setdefault((size, transport.name), []).extend(measure(transport, size, options.count // 10))
    finally:
        for peer in peers:
            peer.kill()
    print(f"one-way hop between two Python processes, microseconds; load {os.getloadavg()[0]:.1f}")
    print(f"{'':<34} {'p50':>9} {'p99':>9} {'max':>9} {'count':>7}")
    for size in SIZES:
        ours = None
        for transport in transports:
            values = times[size, transport.name]
            p50, p99, worst = (np.percentile(values, q, method="higher") for q in (50, 99, 100))
            ours = ours or p50
            label = f"{size * POINT.itemsize // 1024} KiB, {transport.name}"
            print(f"{label:<34} {p50:9.1f} {p99:9.1f} {worst:9.1f} {len(values):7} {p50 / ours:8.2f}x")
    prefix, place = f"evac-{os.getuid()}-{domain}_", Path(f"/tmp/evac-{os.getuid()}") / domain
    transports.clear()
    for left in Path("/dev/shm").glob(prefix + "*"):
        left.unlink(missing_ok=True)
    for left in set(Path("/dev/shm").glob("*.zenoh")) - before:
        left.unlink(missing_ok=True)
    for left in (place, folder):
        shutil.rmtree(left, ignore_errors=True)
    os._exit(0)  # a killed peer's shared memory would be looked for at length


if __name__ == "__main__":
    main()
