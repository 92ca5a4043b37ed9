"""The run loop of a stage that makes one scan out of another, and that can be swapped in and out while the robot walks."""

import argparse
import ctypes
import os
import signal
import sys
import tomllib
import traceback
from collections import deque
from pathlib import Path

from .bus import Bus, Publisher, Subscriber, now_ns
from .gate import ALONE, HAND_OVER, Gate
from .health import FAILED, FINISHED, FOLLOWING, NO_SEQ, READY, RETIRED, RUNNING, WAITING, Reporter
from .layouts import text_of
from .log import start_logging

END_OF_STREAM = 1
LEAD, FOLLOW, DONE = range(3)
# Frames held until the routed instance's output of them comes.
_MAX_HELD = 20


def options_of(kind):
    """The command line that the launcher starts a stage with (shared/stage/src/options.rs); add your own options to it."""
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("--config", type=Path, metavar="PIPELINE.toml", help="pipeline file with this stage's table")
    parser.add_argument("--name", default=kind, help="name of this instance in the pipeline file")
    parser.add_argument("--domain", default="evac", help="space of shared-memory services")
    parser.add_argument("--epoch", type=int, default=0, help="number of this instance")
    parser.add_argument("--standby", action="store_true", help="follow the routed instance until this one is routed")
    parser.add_argument("--die-with-parent", type=int, metavar="PID", help="end when the process PID ends")
    parser.add_argument("--log-level", default="info", help="error, warn, info, debug or trace")
    parser.add_argument("--log-format", default=os.environ.get("EVAC_LOG_FORMAT", "text"), choices=["text", "json"])
    return parser


def run_scan_stage(options, process, reads="lidar/scan", writes="scan/deskewed"):
    """Calls `process(header, points, config)` for each scan and publishes the points that it gives; ends with SIGTERM.

    `points` is a structured array in shared memory (x, y, z in metres, packed), valid during the call only. `header` is
    a copy, to be changed as needed; its number of points is set. `config` is the stage's table of the pipeline file.
    """
    log = start_logging(options.log_level, options.log_format)
    try:
        if options.die_with_parent is not None:
            _die_with(options.die_with_parent)
        stage = _ScanStage(options, process, reads, writes)
    except Exception as cause:
        log.error("%s: %s", options.name, cause)
        sys.exit(5)
    try:
        stage.loop()
        stage.reporter.change(RETIRED if stage.role == DONE else FINISHED)
    except Exception as cause:
        log.error("%s: %s", options.name, "".join(traceback.format_exception(cause)))
        stage.reporter.change(FAILED, str(cause))
        sys.exit(1)


class _ScanStage:
    def __init__(self, options, process, reads, writes):
        self._process, self._config = process, _config(options)
        self._name, self._epoch = options.name, options.epoch
        self._bus = Bus(options.domain, options.name)
        self._input, self._gate = Subscriber(self._bus, reads), Gate(reads)
        self._routes, self._generation = Subscriber(self._bus, "route"), 0
        self.role = FOLLOW if options.standby else LEAD
        # What the routed instance puts out says how far it is.
        self._routed = Subscriber(self._bus, writes) if options.standby else None
        self._output = Publisher(self._bus, writes)
        self._held = deque()
        self._seen, self._from_seq, self._promotion = None, 0, None
        # Last, because it says that everything is open.
        state = FOLLOWING if options.standby else WAITING
        self.reporter = Reporter(self._bus, options.name, options.epoch, state)

    def loop(self):
        """Until SIGTERM. What came before it is still handled."""
        while True:
            self._take_in()
            while self._step():
                self.reporter.report_if_due()
                self._take_in()
            if self._bus.wait(self.reporter.report_if_due()):
                return

    def _take_in(self):
        # The launcher's words first: when one says that an instance has ended, all that it sent is there.
        for route in self._routes.records():
            self._gate.route(route)
            self._order(route)
        while self._routed is not None and (frame := self._routed.receive()) is not None:
            if frame.epoch < self._epoch:
                self._seen = max(frame.seq, -1 if self._seen is None else self._seen)
            frame.close()
        while (frame := self._input.receive()) is not None:
            self._gate.offer(frame)
        while (frame := self._gate.take()) is not None:
            self._held.append((frame, self.reporter.received(frame.header.frame.sent_ns)))
            if len(self._held) > _MAX_HELD:
                self._held.popleft()[0].close()
                self._gate.lost += 1
        self.reporter.health.lost = self._gate.lost

    def _order(self, route):
        """What the launcher asks of this instance, where it is about its stage and news."""
        if text_of(route.stage) != self._name or route.generation <= self._generation:
            return
        self._generation = route.generation
        asks, mine = bool(route.flags & HAND_OVER), route.epoch == self._epoch
        if self.role == LEAD and (mine if asks else route.epoch > self._epoch):
            self.role = DONE
            self.reporter.health.last_seq = NO_SEQ if self._seen is None else self._seen
            self.reporter.change(RETIRED)
        elif self.role == DONE and mine and not asks:
            self.role = LEAD  # the one that was to take over has failed
            self.reporter.change(RUNNING)
        elif self.role == FOLLOW and mine and not asks:
            self._promotion = route

    def _step(self):
        """One frame; False when there is nothing to do."""
        if self.role == FOLLOW:
            return self._follow()
        if self.role == DONE or not self._held:
            return False
        frame, received_ns = self._held.popleft()
        if frame.seq >= self._from_seq:
            self._lead(frame, received_ns)
        frame.close()
        return True

    def _lead(self, frame, received_ns):
        begun_ns = now_ns()
        header = type(frame.header).from_buffer_copy(frame.header)
        points = self._process(header, frame.items, self._config)
        header.points, header.frame.epoch = len(points), self._epoch

        def stamped():
            header.frame.sent_ns = now_ns()
            return header

        self._output.publish_frame(stamped, points)
        self._seen = frame.seq
        self.reporter.done(frame.header.frame, received_ns, begun_ns)
        if frame.header.frame.flags & END_OF_STREAM:
            self.reporter.change(FINISHED)

    def _follow(self):
        """Lets go of what the routed instance is done with, or takes over from it."""
        # The newest one stays: an instance that was killed may have handed its last output to some readers only.
        while len(self._held) > 1 and self._seen is not None and self._held[1][0].seq <= self._seen:
            self._held.popleft()[0].close()
        if self._promotion is not None:
            alone = bool(self._promotion.flags & ALONE)
            again = 0 if self._seen is None else self._seen
            self._from_seq = again if alone else self._promotion.from_seq
            self.role, self._routed = LEAD, None
            self._seen = self._seen if alone or self._from_seq == 0 else self._from_seq - 1
            self._gate.lost = 0
            self.reporter.forget()
            self.reporter.change(RUNNING)
            return True
        if self._held:
            self.reporter.change(READY)
        return False


def _config(options):
    """This stage's table of the pipeline file."""
    if options.config is None:
        return {}
    stages = tomllib.loads(options.config.read_text()).get("stage", [])
    found = [stage for stage in stages if stage.get("name", stage["kind"]) == options.name]
    if not found:
        raise ValueError(f"{options.config} has no stage named '{options.name}'; choose one with --name")
    return found[0].get("config", {})


def _die_with(parent):
    """Asks the kernel to end this process when the launcher ends."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)
    if os.getppid() != parent:
        raise RuntimeError("the launcher has ended")
