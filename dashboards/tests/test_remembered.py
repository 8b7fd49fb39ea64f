"""What the planner remembers is drawn where it stands, the newest map, and goes with its vehicle or its age."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.exports import Format, export_log
from goshawk_dashboards.gate import Access, Gate, Role
from goshawk_dashboards.log import recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.scene.remembered import FUSED, surface
from goshawk_dashboards.scene.scene import LiveScene, ViewOptions
from goshawk_dashboards.state import decode
from goshawk_dashboards.state.snapshot import MAP_STALE_S, Snapshot
from goshawk_dashboards.state.views import RememberedView, TargetView
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]


@pytest.fixture
def scene() -> Iterator[LiveScene]:
    """A scene whose server stands for a browser."""
    gate = Gate(host="127.0.0.1", port=0, access=Access())
    server = open_server(gate, Role.OPERATOR, "test")
    yield LiveScene(server)
    close_server(server)
    gate.close()


def places(scene: LiveScene) -> np.ndarray:
    """Where faces of voxels are drawn, in the world."""
    faces = scene.remembered.faces
    assert faces.node is not None
    middles = np.asarray(faces.node.vertices).reshape(-1, 4, 3).mean(axis=1)[: faces.count]
    return np.asarray(faces.node.position) + middles


def wall_x(scene: LiveScene, front_m: float) -> None:
    """The recording's wall begins there, and is one voxel thick."""
    x_F = places(scene)[:, 0]
    np.testing.assert_allclose([x_F.min(), x_F.max()], [front_m, front_m + 0.2], atol=1e-4)


def test_of_voxels_that_touch_only_the_outside_is_drawn_and_it_looks_out() -> None:
    cells = [(0, 0, 0), (1, 0, 0), (255, 255, 255)]
    seen = decode.remembered(pb.ObstacleMap(voxel_m=0.5, voxels=bytes(n for cell in cells for n in cell)))
    middle_F3, out_F3 = surface(seen)
    assert len(middle_F3) == 5 + 5 + 6
    inward_F3 = middle_F3 - 0.25 * out_F3
    held = {tuple(place) for place in np.round(inward_F3 / 0.5 - 0.5).astype(int).tolist()}
    assert held == set(cells)
    between = np.abs(middle_F3 - (0.5, 0.25, 0.25)).max(axis=1) < 1e-9
    assert not between.any()


def test_a_voxels_place_is_the_middle_of_its_cell() -> None:
    message = pb.ObstacleMap(
        seq=3, origin_world=pb.Vec3(x=-10.0, y=2.0), voxel_m=0.2, voxels=bytes([0, 0, 0, 127, 1, 31])
    )
    seen = decode.remembered(message)
    np.testing.assert_allclose(seen.origin_world_3 + seen.centre_V3, [[-9.9, 2.1, 0.1], [15.5, 2.3, 6.3]])


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (pb.ObstacleMap(voxel_m=0.2, voxels=bytes(4)), "4 bytes"),
        (pb.ObstacleMap(voxel_m=0.2, voxels=bytes(3 * 20_001)), "60003 bytes"),
        (pb.ObstacleMap(voxel_m=0.0), "voxels of 0.0 m"),
        (pb.ObstacleMap(voxel_m=0.2, origin_world=pb.Vec3(x=float("nan"))), "origin is not finite"),
        (pb.ObstacleMap(voxel_m=0.2, depth=pb.DepthBlocks(nearest_dm=bytes(959))), "depth of 959 blocks, not 960"),
        (pb.ObstacleMap(voxel_m=0.2, depth=pb.DepthBlocks(nearest_dm=bytes(960), hfov_rad=1.0)), "1.0 by 0.0 rad"),
    ],
)
def test_a_map_that_makes_no_sense_is_refused(message: pb.ObstacleMap, words: str) -> None:
    with pytest.raises(decode.MalformedError, match=words):
        decode.remembered(message)


def test_the_voxels_are_one_mesh_where_they_stand_and_a_newer_map_takes_its_place(scene: LiveScene, snap: Make) -> None:
    options = ViewOptions()
    scene.update(snap(remembered=decode.remembered(rec.remembered(1.0, 1))), options)
    # Of ten by ten voxels in one layer the front, the back and the four edges.
    assert len(places(scene)) == 100 + 100 + 40
    wall_x(scene, 4.0 + 4.0)
    node = scene.remembered.faces.node
    scene.update(snap(remembered=decode.remembered(rec.remembered(1.0, 1))), options)
    scene.update(snap(remembered=decode.remembered(rec.remembered(2.0, 2))), options)
    wall_x(scene, 8.0 + 4.0)
    assert scene.remembered.faces.node is node, "a node made anew costs a browser its shaders"


def cloud(scene: LiveScene) -> np.ndarray:
    """Where points are drawn, in the world."""
    node = scene.depth.node
    if node is None or not node.visible:
        return np.zeros((0, 3))
    points_P3 = np.asarray(node.points, dtype=float)
    return np.asarray(node.position) + points_P3[points_P3[:, 2] > -1000.0]


def seen_at(x: float, y: float) -> TargetView:
    """A target there."""
    message = rec.target(1.0, 1, seen=True)
    message.pos_world.x, message.pos_world.y = x, y
    return decode.target(message)


def told(time_s: float, seq: int) -> RememberedView:
    """As it comes from the wire."""
    return decode.remembered(rec.remembered(time_s, seq))


def test_a_block_of_depth_is_a_point_where_it_was_measured(scene: LiveScene, snap: Make) -> None:
    scene.update(snap(remembered=told(1.0, 1)), ViewOptions())
    x, y, z = rec.position(1.0)
    right, down = 5.0 / 40, 5.0 * np.tan(np.pi / 6) / 24
    np.testing.assert_allclose(cloud(scene), [[x + 5.0, y - right, z - down]], atol=0.01)


def test_the_last_images_are_one_cloud_without_the_target(scene: LiveScene, snap: Make) -> None:
    for k in range(FUSED + 3):
        for _ in range(2):
            told_now = snap(remembered=told(1.0 + 0.25 * k, k), target=seen_at(-50.0, 0.0))
            scene.update(told_now, ViewOptions())
    assert len(cloud(scene)) == FUSED
    np.testing.assert_allclose(cloud(scene)[-1, 0], rec.position(1.75)[0] + 5.0, atol=0.03)
    node = scene.depth.node
    assert node is not None
    newest, oldest = slice(0, 1), slice(-len(node.colors) // FUSED, None)
    assert node.points[newest][0, 0] > node.points[oldest][0, 0] + 0.5
    assert node.colors[newest].mean() > node.colors[oldest].mean(), "the older are the fainter"
    assert len(node.points) == len(node.colors), "of other numbers and colours viser makes the shaders anew"
    x, y, _ = rec.position(2.75)
    scene.update(snap(remembered=told(2.75, 20), target=seen_at(x + 5.3, y)), ViewOptions())
    assert len(cloud(scene)) == FUSED - 1, "the target itself is no obstacle"
    scene.update(snap(remembered=told(2.0, 21)), ViewOptions())
    assert len(cloud(scene)) == 1, "a vehicle that was started anew begins anew"


def test_images_far_apart_in_time_are_not_one_cloud(scene: LiveScene, snap: Make) -> None:
    for later_s, images in ((0.0, 1), (1.0, 2), (12.0, 1)):
        message = rec.remembered(1.0, 1)
        message.depth.frame_ns += round(later_s * 1e9)
        scene.update(snap(remembered=decode.remembered(message)), ViewOptions())
        assert len(cloud(scene)) == images


def test_what_the_lens_has_passed_is_left_out(scene: LiveScene, snap: Make) -> None:
    scene.update(snap(remembered=told(1.0, 1)), ViewOptions())
    scene.update(snap(remembered=told(3.0, 2)), ViewOptions())
    np.testing.assert_allclose(cloud(scene)[:, 0], rec.position(3.0)[0] + 5.0, atol=0.03)


def test_no_depth_is_drawn_unasked_nor_of_an_older_vehicle(scene: LiveScene, snap: Make) -> None:
    scene.update(snap(remembered=told(1.0, 1)), ViewOptions(depth=False))
    assert len(cloud(scene)) == 0
    scene.update(snap(remembered=told(1.0, 1)), ViewOptions())
    assert len(cloud(scene)) == 1
    older = rec.remembered(2.0, 2)
    older.ClearField("depth")
    scene.update(snap(remembered=decode.remembered(older)), ViewOptions())
    assert len(cloud(scene)) == 0
    scene.update(snap(remembered=told(3.0, 3)), ViewOptions())
    scene.forget()
    assert len(cloud(scene)) == 0


def test_nothing_is_drawn_of_an_old_map_nor_of_another_vehicle_nor_unasked(scene: LiveScene, snap: Make) -> None:
    remembered = decode.remembered(rec.remembered(1.0, 1))
    scene.update(snap(remembered=remembered), ViewOptions(remembered=False))
    assert scene.remembered.faces.count == 0
    scene.update(snap(remembered=remembered), ViewOptions())
    assert scene.remembered.faces.count > 0
    scene.update(snap(remembered=remembered, age_s=MAP_STALE_S + 0.1), ViewOptions())
    assert scene.remembered.faces.count == 0
    scene.update(snap(remembered=remembered), ViewOptions())
    scene.forget()
    assert scene.remembered.faces.count == 0


def test_the_review_shows_the_newest_map_at_or_before_the_time(scene: LiveScene, tmp_path: Path) -> None:
    flight = Flight.open(rec.write_flight(tmp_path / "flight.mcap", 4.0))
    for time_s, shown_s in ((2.0, 2.0), (2.99, 2.0), (3.0, 3.0), (1.0, 1.0)):
        scene.update(recorded.snapshot_at(flight, time_s), ViewOptions())
        wall_x(scene, 4.0 * shown_s + 4.0)
    assert recorded.snapshot_at(flight, -1.0).remembered is None


def test_exports_hold_the_map_and_the_imu(tmp_path: Path) -> None:
    path = rec.write_flight(tmp_path / "flight.mcap", 2.0)
    flight = Flight.open(path)
    for format, topic in ((Format.ROS2, "/remembered"), (Format.FOXGLOVE, "/remembered")):
        assert export_log(flight, format, tmp_path / f"out{format.suffix}").counts[topic] == flight.count("map") == 2
