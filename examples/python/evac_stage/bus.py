"""One process's connection to a domain, and its ports.

What iceoryx2 0.10's Python package would let you do wrong is done right here, once:

- `Slice.len()` counts bytes, not elements (eclipse-iceoryx/iceoryx2 issue 1533): lengths come from the sample's header;
- a numpy view of a sample is memory that the writer uses again after `delete()`: views end with their `Frame`;
- a sample that is not deleted stays borrowed until the garbage collector comes, and borrowed samples are counted;
- whoever opens a service first fixes its numbers for all: every number comes from services.json;
- names and sizes alone do not tell two layouts apart: opening requires the layouts' hashes;
- events are coalesced, and wake again until they are taken: read until nothing is left, and drain the listener.
"""

import ctypes
import os
import time
from pathlib import Path

import iceoryx2 as iox2
import numpy as np

from .layouts import SERVICES, structure

iox2.set_log_level(iox2.LogLevel.Error)

# Opening races with the clean-up of dead processes for a moment; longer than this it is a fault.
_ATTEMPTS, _PAUSE_S = 40, 0.025
_PASSING = ("MarkedForDestruction", "CorruptedState", "HangsInCreation", "ExceedsMax", "AlreadyExists", "SystemInFlux",
            "BeingCreated")


def now_ns():
    """Host monotonic time, as in every frame."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


class Bus:
    """A process in a domain. From now on SIGTERM and SIGINT end `wait` instead of the process."""

    def __init__(self, domain, name):
        uid = os.getuid()
        self.folder = Path(f"/tmp/evac-{uid}") / domain
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        config = iox2.config.default()
        config.global_cfg.prefix = iox2.FileName.new(f"evac-{uid}-{domain}_")
        config.global_cfg.root_path = iox2.Path.new(str(self.folder))
        node = iox2.NodeBuilder.new().config(config).name(iox2.NodeName.new(name))
        self.node = node.signal_handling_mode(iox2.SignalHandlingMode.HandleTerminationRequests).create(
            iox2.ServiceType.Ipc)
        self._waitset = iox2.WaitSetBuilder.new().signal_handling_mode(
            iox2.SignalHandlingMode.HandleTerminationRequests).create(iox2.ServiceType.Ipc)
        self._attached = []

    def data(self, name):
        """The data service of that name."""
        service, item = SERVICES[name], structure(SERVICES[name]["item"])
        verifier = iox2.AttributeVerifier.new().require(
            iox2.AttributeKey.new("layout"), iox2.AttributeValue.new(service["layout"]))
        is_slice = service["header"] is not None
        builder = self.node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(
            iox2.Slice[item] if is_slice else item)
        if is_slice:
            builder = builder.user_header(structure(service["header"]))
        builder = (builder.max_publishers(service["max_publishers"]).max_subscribers(service["max_subscribers"])
                   .max_nodes(service["max_nodes"]).subscriber_max_buffer_size(service["buffer"])
                   .subscriber_max_borrowed_samples(service["borrowed"]).history_size(service["history"])
                   .enable_safe_overflow(True))
        return _retry(name, lambda: builder.open_or_create_with_attributes(verifier))

    def events(self, name):
        """The event service that wakes the readers of a data service."""
        service = SERVICES[name]
        builder = self.node.service_builder(iox2.ServiceName.new(name)).event()
        builder = (builder.max_notifiers(service["max_publishers"]).max_listeners(service["max_subscribers"])
                   .max_nodes(service["max_nodes"]))
        return _retry(name, builder.open_or_create)

    def wake_on(self, name):
        """`wait` ends when something comes on this service. Before the subscriber, so that nothing is missed."""
        events = self.events(name)
        listener = _retry(name, lambda: events.listener_builder().create())
        self._attached.append((listener, self._waitset.attach_notification(listener)))

    def wait(self, seconds):
        """Sleeps until news, a signal or the time-out; whether SIGTERM or SIGINT has come."""
        _, result = self._waitset.wait_and_process_with_timeout(iox2.Duration.from_secs_f64(max(seconds, 0.001)))
        for listener, _ in self._attached:
            listener.try_wait()
        return result == iox2.WaitSetRunResult.TerminationRequest


class Frame:
    """A received frame: `header`, and `items` as a read-only numpy array in shared memory. Both end with `close()`.

    Of a service of records there is `record` instead.
    """

    def __init__(self, sample, item, is_slice):
        self.received_ns = now_ns()
        self._sample = sample
        if is_slice:
            self.header = sample.user_header().contents
            self.items = _array(sample.payload_ptr, sample.header.number_of_elements, item)
            self.items.flags.writeable = False
        else:
            self.header, self.items = None, None
            self.record = sample.payload().contents

    @property
    def seq(self):
        """Number of the scan."""
        return self.header.frame.seq

    @property
    def epoch(self):
        """Which instance wrote it."""
        return self.header.frame.epoch

    def close(self):
        """Gives the memory back to the writer."""
        self.header = self.items = self.record = None
        self._sample.delete()


class Subscriber:
    """Reads a service."""

    def __init__(self, bus, name):
        bus.wake_on(name)
        self._item, self._is_slice = structure(SERVICES[name]["item"]), SERVICES[name]["header"] is not None
        factory = bus.data(name)
        builder = factory.subscriber_builder().buffer_size(SERVICES[name]["buffer"])
        self._port = _retry(name, builder.create)

    def receive(self):
        """The next frame, or None when all are read."""
        sample = self._port.receive()
        return None if sample is None else Frame(sample, self._item, self._is_slice)

    def records(self):
        """All records that have come, each a copy."""
        while (frame := self.receive()) is not None:
            copy = type(frame.record).from_buffer_copy(frame.record)
            frame.close()
            yield copy


class Publisher:
    """Writes a service."""

    def __init__(self, bus, name):
        service = SERVICES[name]
        self._item = structure(service["item"])
        self._factory = bus.data(name)
        builder = self._factory.publisher_builder().max_loaned_samples(2)
        if service["header"] is not None:
            grows = iox2.AllocationStrategy.PowerOfTwo if service["slice_grows"] else iox2.AllocationStrategy.Static
            builder = builder.initial_max_slice_len(service["slice_len"]).allocation_strategy(grows)
        self._port = _retry(name, builder.create)
        events = bus.events(name)
        self._notifier = _retry(name, lambda: events.notifier_builder().create())

    def has_subscriber(self):
        """Whether somebody reads at the moment."""
        return self._factory.dynamic_config.number_of_subscribers > 0

    def publish_frame(self, header, items):
        """Hands over a frame: `items` (a structured array) are written into shared memory once, then `header()`."""
        loan = self._port.loan_slice_uninit(len(items))
        _array(loan.payload_ptr, len(items), self._item)[:] = items
        made = header()
        ctypes.memmove(loan.user_header_ptr, ctypes.byref(made), ctypes.sizeof(made))
        loan.assume_init().send()
        self._notifier.notify()

    def publish_record(self, record):
        """Hands over a record."""
        self._port.send_copy(record)
        self._notifier.notify()


def _array(address, length, item):
    """Shared memory as a numpy array."""
    memory = (ctypes.c_uint8 * (length * ctypes.sizeof(item))).from_address(address)
    return np.ndarray(length, dtype=np.dtype(item), buffer=memory)


def _retry(name, make):
    for attempt in range(_ATTEMPTS):
        try:
            return make()
        except Exception as cause:  # the package's errors have no common base
            if attempt + 1 == _ATTEMPTS or not any(word in str(cause) for word in _PASSING):
                raise RuntimeError(
                    f"service {name} cannot be opened: {cause}; is evac of another version than services.json?") from cause
            time.sleep(_PAUSE_S)
