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


def blind(snap: Snapshot) -> bool:
    """It said that its camera is silent."""
    return any("camera" in event.text and event.severity == pb.SEVERITY_WARNING for event in snap.events)


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
        assert near.wait_for(blind, 10.0) is not None, rig.output("air")
        assert not blind(far.snapshot())
        time.sleep(6.0)  # what is said after an alert is told, too
        weak.mend()
        told = far.wait_for(lambda s: blind(s) and len(s.late) > 10, 40.0)
        assert told is not None, rig.output("air")
        assert told.stop is None and told.command is not None and told.command.answered
        at_ns = next(e.stamp_ns for e in told.events if "camera" in e.text and e.severity == pb.SEVERITY_WARNING)
        assert all(e.late for e in told.events if e.stamp_ns == at_ns)
        assert [e.stamp_ns for e in told.events] == sorted(e.stamp_ns for e in told.events)
        around_ns = [view.stamp_ns for view in told.late if abs(view.stamp_ns - at_ns) <= AROUND_NS]
        assert min(around_ns) < at_ns < max(around_ns)


def test_a_ground_that_opens_late_lists_the_newest_of_a_flood_of_events(rig: Rig) -> None:
    rig.air()
    with rig.link() as near, zenoh.open(client_config(rig.endpoint)) as session:
        assert near.wait_for(lambda s: s.health is not None, 20.0) is not None, rig.output("air")
        for _ in range(KEPT + 60):  # each is refused, which is an event
            request = pb.StartRequest(command_id=str(uuid.uuid4())).SerializeToString()
            session.get(key_expression("cmd_start", near.vehicle), lambda _: None, payload=request, timeout=1.0)
            time.sleep(0.03)
        flooded = near.wait_for(lambda s: len(s.events) == KEPT, 10.0)
        assert flooded is not None
    with rig.link() as late:
        told = late.wait_for(lambda s: len(s.events) == KEPT, 20.0)
        assert told is not None
        assert all(event.late for event in told.events)
        assert "refused" in told.events[-1].text
