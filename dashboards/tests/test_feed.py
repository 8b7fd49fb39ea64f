"""What all who look at a vehicle share: what was told afterwards is drawn where it belongs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from goshawk_dashboards.live.feed import Feed, Watched
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import CommandView, ControlView, EventView
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]


def step(snap: Snapshot, at_s: float, speed: float) -> ControlView:
    """A controller step."""
    assert snap.control is not None
    return replace(
        snap.control, stamp_ns=round(at_s * 1e9), vel_world_3=np.array([speed, 0.0, 0.0]),
        acc_disturbance_world_3=np.array([speed, 0.0, 0.0]),
    )  # fmt: skip


def feed_of(base: Snapshot) -> Feed:
    """Of one vehicle."""
    nothing = CommandView(verb="start", command_id="", answered=False, accepted=False, text="", mode=None)
    vehicle = Watched(
        name="goshawk", latest=lambda: base, on_start=lambda _: nothing, on_stop=bool, on_cancel=bool
    )  # fmt: skip
    return Feed(vehicle)


def test_who_opens_in_flight_knows_its_time_once_the_take_off_is_told(snap: Make) -> None:
    base = snap()
    feed = feed_of(base)
    feed.take(replace(base, control=step(base, 100.0, 1.0)))
    assert "flight time" not in feed.words.status

    def told(*texts: tuple[float, str]) -> Snapshot:
        events = tuple(
            EventView(stamp_ns=round(s * 1e9), severity=pb.SEVERITY_INFO, kind="mode", text=text, late=True)
            for s, text in texts
        )
        return replace(base, control=step(base, 101.0, 1.0), events=events)

    feed.take(told((12.0, "Ready → Takeoff: start accepted"), (36.0, "Ready → Takeoff: start accepted"),
                   (38.0, "Takeoff → Track: the target is confirmed")))  # fmt: skip
    assert "flight time" in feed.words.status and ">1:05<" in feed.words.status


def test_who_opens_in_flight_knows_its_height_above_ground_once_it_is_told_where_it_stood(snap: Make) -> None:
    base = snap()
    feed = feed_of(base)

    def at(at_s: float, z_m: float, mode: pb.Mode = pb.MODE_TRACK) -> ControlView:
        return replace(step(base, at_s, 1.0), pos_world_3=np.array([0.0, 0.0, z_m]), mode=mode)

    feed.take(replace(base, control=at(100.0, 2.0)))
    assert "above ground" not in feed.words.status and ">2.0 m<" in feed.words.status
    stood = (at(35.5, 0.1, pb.MODE_READY), at(35.8, 0.5, pb.MODE_READY), at(36.0, 0.9, pb.MODE_TAKEOFF))
    for at_s in (101.0, 102.0):
        feed.take(replace(base, control=at(at_s, 2.0), late=stood))
    assert "above ground" in feed.words.status and ">1.5 m<" in feed.words.status, "it stood at 0.5 m last"
    feed.take(replace(base, control=at(103.0, 0.2, pb.MODE_READY), late=stood))
    feed.take(replace(base, control=at(104.0, 2.0), late=(*stood, at(36.1, 1.0, pb.MODE_READY))))
    assert ">1.8 m<" in feed.words.status, "what was seen counts more"


def test_what_was_told_after_a_cut_fills_the_gap_of_the_charts_once(snap: Make) -> None:
    base = snap()
    feed = feed_of(base)
    for at_s in (10.0, 20.0):
        feed.take(replace(base, control=step(base, at_s, 1.0)))
    assert base.target is not None
    target = replace(base.target, stamp_ns=round(13.95e9), covariance_66=np.diag([0.04] * 3 + [0.25] * 3))
    late = (step(base, 13.0, 5.0), target, step(base, 14.0, 5.0))
    for at_s in (20.5, 21.0):
        feed.take(replace(base, control=step(base, at_s, 1.0), late=late))
    ago_S, columns = feed.track.window(60.0)
    assert ago_S.tolist() == [-11.0, -8.0, -7.0, -1.0, -0.5, 0.0]
    assert columns["disturbance east"].tolist() == [1.0, 5.0, 5.0, 1.0, 1.0, 1.0]
    for column, sigma in (("position", 0.2), ("velocity", 0.5)):
        assert np.isnan(columns[column][1]) and np.isclose(columns[column][2], sigma), (
            "of one step's target it was told"
        )
