"""A reviewed flight's scene, where a server stands for a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.gate import Access, Gate, Role
from goshawk_dashboards.log import recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.review.scene import ReviewOptions, ReviewScene
from goshawk_dashboards.scene.scene import ViewOptions

SHOWN = ReviewOptions(view=ViewOptions(depth=False), depth=True, replay=False, others="Hidden")


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    """Its camera looks east at a wall 4 m ahead."""
    return Flight.open(rec.write_flight(tmp_path / "flight.mcap"))


@pytest.fixture
def scene(flight: Flight) -> Iterator[ReviewScene]:
    gate = Gate(host="127.0.0.1", port=0, access=Access())
    server = open_server(gate, Role.OPERATOR, "test")
    yield ReviewScene(server, [flight], None)
    close_server(server)
    gate.close()


def test_measured_depth_stays_one_cloud_and_lies_where_it_was_measured(scene: ReviewScene, flight: Flight) -> None:
    clouds = list[object]()
    for time_s in (2.0, 2.5, 6.0):
        scene.update(recorded.snapshot_at(flight, time_s), None, SHOWN, (0.0,))
        plan = flight.plan_at(time_s)
        assert plan is not None and scene.depth is not None and scene.depth.visible
        drawn_P3 = np.asarray(scene.depth.points, dtype=np.float64) + scene.depth.position
        assert np.allclose(drawn_P3[:, 0] - plan.start_pos_world_3[0], 4.0, atol=0.06)
        assert len(drawn_P3) == len(scene.depth.colors)
        clouds.append(scene.depth)
    assert clouds[0] is clouds[1] is clouds[2], "a cloud that is made anew flickers"
    hidden = ReviewOptions(view=ViewOptions(depth=False), depth=False, replay=False, others="Hidden")
    scene.update(recorded.snapshot_at(flight, 6.0), None, hidden, (0.0,))
    assert not scene.depth.visible
