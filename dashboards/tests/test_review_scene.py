"""A reviewed flight's scene, where a server stands for a browser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
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
    scene.update(recorded.snapshot_at(flight, 6.0), None, replace(SHOWN, depth=False), (0.0,))
    assert not scene.depth.visible


def test_a_cloud_shows_all_points_of_an_image_and_no_others(
    scene: ReviewScene, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    snap, images = recorded.snapshot_at(flight, 2.0), list[tuple[np.ndarray, np.ndarray]]()

    def newest(_flight: Flight, _time_s: float) -> tuple[np.ndarray, np.ndarray]:
        return images[-1]

    monkeypatch.setattr(recorded, "depth_points", newest)
    for count in (5, 3, 9):
        points_P3 = np.arange(3.0 * count).reshape(count, 3) + 1000.0
        images.append((points_P3, np.arange(3 * count, dtype=np.uint8).reshape(count, 3)))
        scene.update(snap, None, SHOWN, (0.0,))
        assert scene.depth is not None and scene.depth.visible
        drawn = np.hstack([np.asarray(scene.depth.points) + scene.depth.position, np.asarray(scene.depth.colors)])
        assert np.allclose(np.unique(drawn, axis=0), np.hstack(images[-1]), atol=0.02)
