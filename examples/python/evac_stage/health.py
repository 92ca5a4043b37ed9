"""A stage's report about itself on `health/status`, each second and at every change."""

import math
import os

from .bus import Publisher, now_ns
from .layouts import by_type, text

WAITING, RUNNING, FINISHED, FAILED, FOLLOWING, READY, RETIRED = range(7)
NO_SEQ = 2**64 - 1
_INTERVAL_NS = 1_000_000_000
_GROWTH = math.log(1.01)


class Latency:
    """A histogram with 1 % resolution."""

    def __init__(self):
        self._bins, self._count, self._max = {}, 0, 0

    def record(self, nanoseconds):
        """Counts a value."""
        number = int(math.log(max(nanoseconds, 1000) / 1000) / _GROWTH)
        self._bins[number] = self._bins.get(number, 0) + 1
        self._count += 1
        self._max = max(self._max, nanoseconds)

    def write(self, summary):
        """Writes count and percentiles."""
        summary.count, summary.max_ns = self._count, self._max
        summary.p50_ns, summary.p99_ns = self._quantile(0.5), self._quantile(0.99)

    def _quantile(self, share):
        seen = 0
        for number in sorted(self._bins):
            seen += self._bins[number]
            if seen >= share * self._count:
                return min(int(1000 * math.exp((number + 1) * _GROWTH)), self._max)
        return 0


class Reporter:
    """Counts, times and reports."""

    def __init__(self, bus, name, epoch, state):
        self._port, self._traces = Publisher(bus, "health/status"), Publisher(bus, "trace/frame")
        self.health, self._trace = by_type("Health")(), by_type("Trace")()
        for record in (self.health, self._trace):
            record.name, record.epoch = text(name, type(record.name)), epoch
        self.health.pid, self.health.state = os.getpid(), state
        self.forget()
        self.publish()

    def forget(self):
        """Begins to count anew."""
        self._ipc, self._compute, self._end_to_end = Latency(), Latency(), Latency()
        self.health.frames_in = self.health.frames_out = 0
        self._last = (now_ns(), 0)

    def received(self, sent_ns):
        """A frame has come from another process; gives when."""
        self.health.last_input_ns = now_ns()
        self._ipc.record(self.health.last_input_ns - sent_ns)
        return self.health.last_input_ns

    def done(self, frame, received_ns, begun_ns):
        """The output of a frame is handed over."""
        done_ns = now_ns()
        health = self.health
        health.frames_in += 1
        health.frames_out += 1
        health.last_seq = frame.seq
        health.state = RUNNING if health.state == WAITING else health.state
        self._compute.record(done_ns - begun_ns)
        self._end_to_end.record(done_ns - frame.arrival_ns)
        if self._traces.has_subscriber():
            trace = self._trace
            trace.seq, trace.arrival_ns, trace.sent_ns = frame.seq, frame.arrival_ns, frame.sent_ns
            trace.received_ns, trace.begun_ns, trace.done_ns = received_ns, begun_ns, done_ns
            self._traces.publish_record(trace)

    def change(self, state, reason=""):
        """Reports a state at once where it is another than before."""
        if (state, reason) != (self.health.state, ""):
            self.health.state, self.health.reason = state, text(reason, type(self.health.reason))
            self.publish()

    def report_if_due(self):
        """Reports each second; seconds until the next."""
        due_ns = self._last[0] + _INTERVAL_NS - now_ns()
        if due_ns > 0:
            return due_ns * 1e-9
        self.publish()
        return 1.0

    def publish(self):
        """Reports."""
        now, (then, frames) = now_ns(), self._last
        if now - then >= _INTERVAL_NS // 2:
            self.health.rate_millihertz = round((self.health.frames_in - frames) * 1e12 / (now - then))
            self._last = (now, self.health.frames_in)
        self.health.reported_ns = now
        for latency, summary in ((self._ipc, self.health.ipc), (self._compute, self.health.compute),
                                 (self._end_to_end, self.health.end_to_end)):
            latency.write(summary)
        self._port.publish_record(self.health)
