"""Of the frames of several instances of the stage before, each exactly once and in order: shared/stage/src/gate.rs in short.

The launcher's route says from which `seq` on which `epoch` is listened to. What one instance sends comes in order, so a
gap in it is a loss; a frame that another instance may still send is waited for, with at most 20 early ones held.
"""

from .layouts import text_of

HAND_OVER, ALONE = 1, 2
_MAX_EARLY = 20


class Gate:
    """See the module's text."""

    def __init__(self, service):
        self._service = service
        self._next = None
        self._cut = None
        self._early = []
        self.lost = self.late = 0

    def route(self, route):
        """Takes the launcher's word."""
        newer = self._cut is None or route.generation > self._cut.generation
        if newer and not route.flags & HAND_OVER and text_of(route.service) == self._service:
            self._cut = route

    def offer(self, frame):
        """Takes a frame that has come."""
        if self._next is not None and frame.seq < self._next:
            frame.close()  # another instance's copy
        else:
            self._early.append(frame)

    def take(self):
        """The frame that can be handed on now, or None."""
        candidates = [frame for frame in self._early if self._listens(frame.seq, frame.epoch)]
        if not candidates:
            while len(self._early) > _MAX_EARLY:  # of an instance that nobody routes
                self._early.pop(0).close()
            return None
        first = min(candidates, key=lambda frame: (frame.seq, frame.epoch))
        want = first.seq if self._next is None else self._next
        if first.seq > want and not self._listens(want, first.epoch) and len(self._early) <= _MAX_EARLY:
            return None
        self.lost += first.seq - want
        self._next = first.seq + 1
        for frame in [frame for frame in self._early if frame.seq < self._next and frame is not first]:
            frame.close()
        self._early = [frame for frame in self._early if frame.seq >= self._next]
        return first

    def _listens(self, seq, epoch):
        cut = self._cut
        if cut is None:
            return True
        alone = bool(cut.flags & ALONE)
        if seq >= cut.from_seq:
            return epoch == cut.epoch or (alone and epoch < cut.epoch)
        return epoch < cut.epoch or (alone and epoch == cut.epoch)
