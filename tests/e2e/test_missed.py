"""What a ground hears of the time in which it was away: real processes, a real link that is cut."""

from __future__ import annotations

import os
import signal
import time
import uuid

import zenoh
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.link import GroundLink, client_config
from goshawk_proto import goshawk_pb2 as pb
from goshawk_proto import key_expression
from rig import Rig
from weak_link import WeakLink

AROUND_NS = 5_000_000_000
"""So long before and after an alert the vehicle keeps what it said."""
KEPT = 200
"""So many events it keeps."""


def blind_ns(snap: Snapshot) -> int | None:
    """When it said that its camera is silent."""
    told = (e.stamp_ns for e in snap.events if "camera" in e.text and e.severity == pb.SEVERITY_WARNING)
    return next(told, None)


def around_ns(snap: Snapshot) -> list[int]:
    """Of the samples that were told afterwards those about that, from it."""
    at_ns = blind_ns(snap)
    off_ns = [] if at_ns is None else [view.stamp_ns - at_ns for view in snap.late]
    return [off for off in off_ns if abs(off) <= AROUND_NS]


def test_after_a_cut_the_stop_comes_first_then_what_happened_meanwhile_in_its_place(rig: Rig) -> None:
    rig.air()
    sim = rig.sim("--seed", "3")
    with WeakLink(to_port=rig.zenoh_port) as weak, GroundLink(connect=weak.endpoint) as far, rig.link() as near:
        ready = far.wait_for(lambda s: s.health is not None and s.health.ready and s.control is not None, 60.0)
        assert ready is not None, rig.output("air")
        weak.cut()
        assert far.wait_for(lambda s: not s.linked, 15.0) is not None
        far.press_stop()
        os.killpg(sim.pid, signal.SIGKILL)
        assert near.wait_for(lambda s: blind_ns(s) is not None, 10.0) is not None, rig.output("air")
        assert blind_ns(far.snapshot()) is None
        time.sleep(2.0)  # what is said after an alert is told, too
        weak.mend()
        told = far.wait_for(lambda s: max(around_ns(s), default=0) > 0, 40.0)
        assert told is not None, rig.output("air")
        assert told.stop is None and told.command is not None and told.command.answered
        assert min(around_ns(told)) < 0
        assert [e.late for e in told.events if e.stamp_ns == blind_ns(told)] == [True]
        assert [e.stamp_ns for e in told.events] == sorted(e.stamp_ns for e in told.events)


def test_a_ground_that_opens_late_lists_the_newest_of_a_flood_of_events(rig: Rig) -> None:
    rig.air()
    with rig.link() as near:
        assert near.wait_for(lambda s: s.health is not None, 20.0) is not None, rig.output("air")
        session = zenoh.open(client_config(rig.endpoint))
        for _ in range(KEPT + 60):  # each is refused, which is an event
            request = pb.StartRequest(command_id=str(uuid.uuid4())).SerializeToString()
            session.get(key_expression("cmd_start", near.vehicle), lambda _: None, payload=request, timeout=1.0)
            time.sleep(0.03)
        session.close()
        flooded = near.wait_for(lambda s: len(s.events) == KEPT, 10.0)
        assert flooded is not None
    with rig.link() as late:
        told = late.wait_for(lambda s: len(s.events) == KEPT, 20.0)
        assert told is not None
        assert all(event.late for event in told.events)
        assert "refused" in told.events[-1].text
