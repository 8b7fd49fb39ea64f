"""What the vehicle told while nobody here heard it: which events and which seconds are missing, and what to ask for.

Each event has a number, and each heartbeat says how many there are. Where two heartbeats are far apart, the seconds
between them are missing. A ground that opens late misses all that was before it. Pure, and bounded.
"""

from __future__ import annotations

from collections import deque

from goshawk_dashboards.state.airborne import took_off
from goshawk_proto import goshawk_pb2 as pb

GAP_S = 1.5
"""A vehicle whose heartbeat, which comes twice a second, was not heard for this long was away."""
BEFORE_S = 120.0
"""Of the time before it opened a ground asks for so much, its longest chart; events it asks for whenever they were."""
STOOD_S = 1.0
"""Of a take-off before that it asks for so much, to learn where the vehicle stood."""
GAPS = 16
"""Most gaps that wait to be asked about; the oldest is forgotten."""
EVENTS_BEYOND = 1024
"""Most events that are had beyond one that is missing; then the missing ones are given up."""
STEPS = 256
"""The newest controller steps, and estimates of the target, by which one that is told again is known: some seconds."""


class Missed:
    """One vehicle's account. Stamps are of its clock."""

    def __init__(self) -> None:
        self._session = 0
        self._told = 0
        """Events of the session, as the newest heartbeat says."""
        self._upto = 0
        """Every event up to this one is here, or is kept nowhere."""
        self._beyond: set[int] = set()
        """Later events that are here."""
        self._given_up = 0
        self._heard_ns: int | None = None
        self._gaps: deque[tuple[int, int]] = deque(maxlen=GAPS)
        self._steps: deque[int] = deque(maxlen=STEPS)
        self._targets: deque[int] = deque(maxlen=STEPS)

    @property
    def held(self) -> int:
        """How many numbers are kept: bounded."""
        return len(self._beyond) + 2 * len(self._gaps) + len(self._steps) + len(self._targets)

    def heard_step(self, stamp_ns: int) -> None:
        """A controller step came."""
        self._steps.append(stamp_ns)

    def heard_target(self, stamp_ns: int) -> None:
        """An estimate of the target came."""
        self._targets.append(stamp_ns)

    def heard_event(self, seq: int) -> None:
        """An event came; 0: the vehicle does not number them."""
        if seq > self._upto:
            self._beyond.add(seq)
        if len(self._beyond) > EVENTS_BEYOND:
            self._upto = max(self._beyond)
        self._close_up()

    def _close_up(self) -> None:
        """Counts what follows without a gap as had."""
        while self._upto + 1 in self._beyond:
            self._upto += 1
        self._beyond = {later for later in self._beyond if later > self._upto}

    def heard_health(self, health: pb.Health) -> None:
        """A heartbeat came."""
        if health.session not in (0, self._session):
            if self._session:
                self._upto, self._beyond = 0, set[int]()
            self._session, self._given_up = health.session, 0
        self._told = health.events
        before_ns, self._heard_ns = self._heard_ns, health.stamp_ns
        if before_ns is None or health.stamp_ns < before_ns:
            # It was not heard yet, or its clock began anew.
            self._gaps.append((max(0, health.stamp_ns - round(BEFORE_S * 1e9)), health.stamp_ns))
        elif health.stamp_ns - before_ns > GAP_S * 1e9:
            self._gaps.append((before_ns, health.stamp_ns))

    def request(self) -> pb.MissedRequest | None:
        """What to ask for; None: nothing is missing, or the vehicle is one that cannot tell."""
        lacks_events = self._told > max(self._upto, self._given_up)
        if not self._session or not (self._gaps or lacks_events):
            return None
        after_ns, before_ns = self._gaps[0] if self._gaps else (0, 0)
        return pb.MissedRequest(session=self._session, after_event=self._upto, after_ns=after_ns, before_ns=before_ns)

    def take(self, asked: pb.MissedRequest, page: pb.Missed) -> bool:
        """An answer came. False: it is of no use, for it is of another session, or promises more and brings nothing."""
        samples = (*page.controls, *page.targets, *page.healths)
        if page.session != self._session or (page.more and not (page.events or samples)):
            return False
        # No more can have been dropped than were told, whatever the page says.
        self._upto = max(self._upto, min(asked.after_event + page.dropped_events, self._told))
        self._close_up()
        for event in page.events:
            self.heard_event(event.seq)
        for control in [control for control in page.controls if control.stamp_ns in self._steps]:
            page.controls.remove(control)
        for target in [target for target in page.targets if target.stamp_ns in self._targets]:
            page.targets.remove(target)
        if self._gaps and self._gaps[0] == (asked.after_ns, asked.before_ns):
            self._gaps.popleft()
            if page.more:
                newest_ns = max((sample.stamp_ns for sample in samples), default=asked.after_ns)
                self._gaps.appendleft((newest_ns, asked.before_ns))
        took_off_ns = [event.stamp_ns for event in page.events if took_off(event.kind, event.text)]
        if took_off_ns and took_off_ns[-1] < asked.after_ns:
            self._gaps.append((max(0, took_off_ns[-1] - round(STOOD_S * 1e9)), took_off_ns[-1]))
        if not page.more:
            self._given_up = max(self._given_up, self._told)  # what it still lacks is kept nowhere
        return True

    def give_up(self) -> None:
        """No answer comes. It is asked again when more is missing."""
        self._gaps.clear()
        self._given_up = self._told
