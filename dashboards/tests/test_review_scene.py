"""A reviewed flight's scene, where a server stands for a browser."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
import viser
from goshawk_dashboards.gate import Access, Gate, Role
from goshawk_dashboards.log import recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.review.dashboard import Recording, ReviewView
from goshawk_dashboards.review.scene import ReviewOptions, ReviewScene
from goshawk_dashboards.scene.scene import ViewOptions
from goshawk_proto import goshawk_pb2 as pb

SHOWN = ReviewOptions(view=ViewOptions(depth=False), depth=True, replay=False, others="Hidden")


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    """Its camera looks east at a wall 4 m ahead."""
    return Flight.open(rec.write_flight(tmp_path / "flight.mcap"))


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    """Stands for a browser."""
    gate = Gate(host="127.0.0.1", port=0, access=Access())
    server = open_server(gate, Role.OPERATOR, "test")
    yield server
    close_server(server)
    gate.close()


@pytest.fixture
def scene(server: viser.ViserServer, flight: Flight) -> ReviewScene:
    """Of the flight alone."""
    return ReviewScene(server, [flight], None)


def ground_recording(path: Path, duration_s: int = 20) -> Path:
    """What a ground recorded of a flight: telemetry, whose pictures are small, and no frames."""
    log = rec.LogFile(path)
    for step in range(duration_s * 20):
        time_s = step / 20
        stamp_ns = rec.START_NS + round(time_s * 1e9)
        log.write("control", stamp_ns, rec.control(time_s, step, duration_s))
        log.write("plan", stamp_ns, rec.plan(time_s, step))
        if step % 20 == 0:
            log.write("map", stamp_ns, rec.remembered(time_s, step))
        if step % 4 == 0:
            jpeg = b"picture %d" % step
            log.write("preview", stamp_ns, pb.Preview(seq=step, stamp_ns=stamp_ns, width=4, height=3, jpeg=jpeg))
    log.close()
    return path


def test_what_the_ground_recorded_shows_the_links_picture_and_the_maps_depth(
    server: viser.ViserServer, tmp_path: Path
) -> None:
    flight = Flight.open(ground_recording(tmp_path / "ground.mcap"))
    snap = recorded.snapshot_at(flight, 2.1)
    assert snap.preview is not None and snap.preview.picture == b"picture 40"
    assert snap.age_s("preview") == pytest.approx(0.1)
    view = ReviewView(server, Recording.of([flight], None, None, None), threading.Event())
    view.player.seek(2.1)
    view.show()
    assert view.panels.options.view.depth
    node = view.scene.first.depth.node
    assert node is not None and node.visible
    assert node.position[0] == pytest.approx(rec.position(2.0)[0], abs=0.01)
    assert view.scene.depth is None, "there are no frames to draw in full"


def test_of_a_flight_with_frames_the_maps_depth_is_not_drawn_beside_theirs(
    server: viser.ViserServer, flight: Flight
) -> None:
    view = ReviewView(server, Recording.of([flight], None, None, None), threading.Event())
    view.player.seek(2.1)
    view.show()
    assert view.scene.depth is not None and view.scene.depth.visible
    assert view.scene.first.depth.node is None


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


def test_before_a_flight_begins_nothing_of_it_is_drawn_and_the_others_are(
    server: viser.ViserServer, tmp_path: Path
) -> None:
    flights = [Flight.open(rec.write_flight(tmp_path / f"{k}.mcap", 6.0 + k)) for k in (0, 2)]
    recording = Recording.of(flights, None, None, None)
    view = ReviewView(server, recording, threading.Event())
    view.seat.by_s = recording.table.alignments["landing"]
    view.player.begin_s, view.player.end_s = recording.table.axis_s(view.seat.by_s)
    (other,) = view.scene.others
    for time_s, seen in ((1.0, True), (-1.5, False), (1.0, True)):
        view.player.seek(time_s)
        view.show()
        assert view.shown_s == time_s
        assert view.scene.first.vehicle.visible is seen
        assert other.scene.vehicle.visible
        assert other.scene.vehicle.position[0] == pytest.approx(4.0 * (time_s + 2.0), abs=0.03)
