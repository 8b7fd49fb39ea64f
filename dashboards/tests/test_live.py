"""The dashboard puts a snapshot into the scene: read back from the server's own scene state."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest
from goshawk_dashboards.gate import Access, Gate, PortBusyError, Role
from goshawk_dashboards.live.dashboard import LiveDashboard, LiveView
from goshawk_dashboards.live.feed import Watched
from goshawk_dashboards.page import theme
from goshawk_dashboards.scene.relief import Relief
from goshawk_dashboards.scene.scene import CANDIDATE_RADIUS_M, SAMPLES
from goshawk_dashboards.scene.tubes import Bundle
from goshawk_dashboards.scene.world import NEAR_M
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import BoxesView, CommandView, PreviewView, TruthView, WorldView
from goshawk_proto import goshawk_pb2 as pb
from PIL import Image

Make = Callable[..., Snapshot]


def _command(verb: str) -> CommandView:
    return CommandView(verb=verb, command_id="1", answered=True, accepted=True, text="ok", mode=pb.MODE_TAKEOFF)


def gate(port: int = 0) -> Gate:
    """On a free port, or on this one."""
    return Gate(host="127.0.0.1", port=port, access=Access())


def boxes(count: int, x_m: float = 0.0) -> BoxesView:
    """Cubes of 1 m at x_m."""
    return BoxesView(
        centre_world_B3=np.tile([x_m, 0.0, 0.5], (count, 1)), size_m_B3=np.ones((count, 3)), yaw_rad_B=np.zeros(count)
    )


def truth(moving: BoxesView) -> TruthView:
    """The simulator's truth with obstacles that move."""
    zero_3 = np.zeros(3)
    return TruthView(
        stamp_ns=1,
        pos_world_3=zero_3,
        vel_world_3=zero_3,
        acc_world_3=np.array([1.0, 2.0, 3.0]),
        target_pos_world_3=zero_3,
        target_vel_world_3=zero_3,
        clearance_m=1.0,
        collisions=0,
        target_distance_m=5.0,
        target_path_m=0.0,
        target_arrived=False,
        target_visible=True,
        moving=moving,
    )


def preview() -> PreviewView:
    """A picture that can be drawn."""
    data = io.BytesIO()
    Image.new("RGB", (4, 3)).save(data, "PNG")
    return PreviewView(seq=1, stamp_ns=1, width=4, height=3, picture=data.getvalue())


def watched(name: str, snap: Make) -> Watched:
    """A vehicle that answers at once."""
    return Watched(
        name=name,
        latest=snap,
        on_start=lambda _: _command("start"),
        on_stop=lambda: _command("stop"),
        on_cancel=lambda: None,
    )


class Live:
    """One viewer of a dashboard whose own thread is not running: the tests tick it. The server stands for a browser."""

    def __init__(self, *vehicles: Watched) -> None:
        self.dashboard = LiveDashboard(gate=gate(), vehicles=vehicles)
        self.server = self.dashboard.servers[Role.OPERATOR]
        view = LiveView(self.server, self.dashboard.feeds)
        self.scene, self.panels, self._view = view.scene, view.panels, view

    def tick(self, *snaps: Snapshot) -> None:
        """Shows one snapshot a vehicle."""
        for feed, snap in zip(self.dashboard.feeds, snaps, strict=True):
            feed.take(snap)
            feed.judge()
        self._view.draw(words=True, slow=True)


@pytest.fixture
def live(snap: Make) -> Iterator[Live]:
    """A viewer of one vehicle."""
    live = Live(watched("goshawk", snap))
    yield live
    live.dashboard.close()


def test_the_vehicle_stands_where_control_says(live: Live, snap: Make) -> None:
    live.tick(snap())
    np.testing.assert_allclose(live.scene.vehicle.position, [10.0, 0.0, 2.0])
    assert live.scene.vehicle.visible


def test_fifteen_curves_start_at_the_plan_and_end_at_its_end_states(live: Live, snap: Make) -> None:
    plan = snap().plan
    live.tick(snap())
    fan, chosen = live.scene.candidates, live.scene.chosen
    assert plan is not None
    ends = np.concatenate([bundle.curves_KS3[:, -1] for bundle in fan.bundles.values()]) + np.asarray(fan.root.position)
    by_end = np.lexsort(ends.round(5).T), np.lexsort(plan.end_pos_world_N3.round(5).T)
    np.testing.assert_allclose(ends[by_end[0]], plan.end_pos_world_N3[by_end[1]], atol=1e-5)
    for tubes in (*fan.bundles.values(), chosen):
        assert tubes.node is not None
        # A section has three corners, about the curve.
        drawn_KS3 = np.asarray(tubes.node.vertices).reshape(-1, SAMPLES, 3, 3).mean(axis=2)
        curves_KS3 = tubes.curves_KS3 if isinstance(tubes, Bundle) else tubes.curve_S3[None]
        np.testing.assert_allclose(drawn_KS3, curves_KS3, atol=1e-5)
        start_3 = np.asarray(fan.root.position)
        starts_K3 = np.tile(plan.start_pos_world_3, (len(drawn_KS3), 1))
        np.testing.assert_allclose(drawn_KS3[:, 0] + start_3, starts_K3, atol=1e-5)
    np.testing.assert_allclose(chosen.curve_S3[-1] + np.asarray(fan.root.position), plan.end_pos_world_N3[7], atol=1e-5)
    corner_33 = np.asarray(chosen.node.vertices)[:3]
    thick_m = np.linalg.norm(corner_33 - corner_33.mean(axis=0), axis=1).min()
    assert thick_m > 2 * CANDIDATE_RADIUS_M, "what is flown stands out"


def test_rejected_candidates_are_grey_and_the_others_coloured_by_cost(live: Live, snap: Make) -> None:
    live.tick(snap())
    plan = snap().plan
    assert plan is not None
    bundles = live.scene.candidates.bundles

    def drawn_in(color: theme.Rgb) -> list[int]:
        """Which candidates are, by where they end."""
        node = bundles[color].node
        assert node is not None and tuple(node.color) == color
        ends = bundles[color].curves_KS3[:, -1] + plan.start_pos_world_3
        return [int(np.linalg.norm(plan.end_pos_world_N3 - end, axis=1).argmin()) for end in ends]

    assert drawn_in(theme.REJECTED) == [k for k in range(15) if k not in (6, 7, 8)]
    assert drawn_in(theme.vivid(theme.GOOD)) == [6]
    assert drawn_in(theme.vivid(theme.BAD)) == [8]


def test_a_stale_plan_is_not_drawn(live: Live, snap: Make) -> None:
    live.tick(snap())
    live.tick(snap(age_s=2.0))
    assert not live.scene.candidates.root.visible
    assert not live.scene.chosen.node.visible
    assert not live.scene.target.frame.visible
    live.tick(snap())
    assert live.scene.candidates.root.visible


def test_no_choice_draws_no_thick_line(live: Live, snap: Make) -> None:
    base = snap()
    assert base.plan is not None
    live.tick(replace(base, plan=replace(base.plan, chosen=None)))
    assert live.scene.candidates.root.visible
    assert not live.scene.chosen.node.visible


def test_trees_appear_and_go_with_the_simulator(live: Live, snap: Make) -> None:
    world = WorldView(
        base_world_K3=np.zeros((3, 3)),
        top_world_K3=np.tile([0.3, 0.0, 6.0], (3, 1)),
        radius_m_K=np.full(3, 0.2),
        foliage_radius_m_K=np.array([0.0, 1.0, 1.2]),
        boxes=boxes(0),
        seed=1,
        spacing_m=4.0,
    )
    drawn = live.scene.world
    live.tick(snap(world=world))
    assert (drawn.trunks.count, drawn.foliage.count) == (3, 2)
    node = drawn.trunks.node
    assert node is not None and node.visible
    live.tick(snap())
    assert (drawn.trunks.count, drawn.foliage.count) == (0, 0)
    assert drawn.trunks.node is node and not node.visible, "a node made anew costs a browser its shaders"


def forest(rows: int, slope: float = 0.0) -> WorldView:
    """A tree each 4 m along the way east and beside it, on ground that rises to the east."""
    x, y = (v.ravel() for v in np.meshgrid(4.0 * np.arange(rows), 4.0 * np.arange(-2, 3)))
    base_K3 = np.stack([x, y, slope * x], axis=1).astype(np.float64)
    return WorldView(
        base_world_K3=base_K3,
        top_world_K3=base_K3 + np.array([0.0, 0.0, 6.0]),
        radius_m_K=np.full(len(x), 0.2),
        foliage_radius_m_K=np.ones(len(x)),
        boxes=boxes(0),
        seed=1,
        spacing_m=4.0,
    )


def test_of_a_forest_only_what_is_near_the_vehicle_is_drawn_and_it_follows(live: Live, snap: Make) -> None:
    base, world = snap(), forest(rows=100)
    assert base.control is not None
    for x_m in (0.0, 200.0):
        control = replace(base.control, pos_world_3=np.array([x_m, 0.0, 2.0]))
        live.tick(replace(base, control=control, world=world))
        trunks = live.scene.world.trunks
        assert 0 < trunks.count < len(world.radius_m_K)
        assert np.abs(trunks.pos_B3[:, 0] - x_m).max() < NEAR_M
        assert trunks.node is not None
        corners_B3 = np.asarray(trunks.node.vertices)
        assert np.abs(corners_B3[:, 0] - x_m).max() < NEAR_M + 1.0, "what was drawn before is still there"


def test_of_many_walls_only_what_is_near_the_vehicle_is_drawn_and_it_follows(live: Live, snap: Make) -> None:
    row = replace(boxes(100), centre_world_B3=np.array([[4.0 * k, 0.0, 0.5] for k in range(100)]))
    # A long wall's middle may be far from where it stands near.
    long = replace(boxes(1, NEAR_M + 15.0), size_m_B3=np.array([[40.0, 1.0, 1.0]]))
    base, walls = snap(), live.scene.world.boxes
    assert base.control is not None
    worlds = [replace(forest(rows=1), boxes=boxes_drawn) for boxes_drawn in (row, long)]
    for k, at_m, count in ((0, 0.0, 9), (0, 200.0, 17), (1, 0.0, 1), (1, 200.0, 0)):
        control = replace(base.control, pos_world_3=np.array([at_m, 0.0, 2.0]))
        live.tick(replace(base, control=control, world=worlds[k]))
        assert walls.count == count


def test_the_ground_rises_where_its_trees_stand_higher(live: Live, snap: Make) -> None:
    world = forest(rows=20, slope=0.1)
    relief = Relief(world)
    np.testing.assert_allclose(relief.height_M(np.array([[20.0, 4.0], [42.0, 2.0]])), [2.0, 4.2], atol=0.02)
    vertices, faces = relief.mesh()
    assert faces.max() == len(vertices) - 1
    live.tick(snap(world=world))
    assert live.server.scene.get_handle_by_name("/world/ground") is not None
    grid = live.server.scene.get_handle_by_name("/ground")
    assert grid is not None and not grid.visible
    words = live.dashboard.feeds[0].words.status
    assert ">1.0 m<" in words, "the vehicle at 10 m east is 1 m above its ground"
    live.tick(snap())
    assert grid.visible
    assert live.server.scene.get_handle_by_name("/world/ground") is None


def test_walls_are_one_mesh_and_moving_obstacles_follow_the_truth(live: Live, snap: Make) -> None:
    none_K3, none_K = np.zeros((0, 3)), np.zeros(0)
    world = WorldView(
        base_world_K3=none_K3,
        top_world_K3=none_K3,
        radius_m_K=none_K,
        foliage_radius_m_K=none_K,
        boxes=boxes(300),
        seed=1,
        spacing_m=0.0,
    )
    drawn = live.scene.world
    live.tick(snap(world=world, truth=truth(boxes(2, x_m=5.0))))
    assert drawn.boxes.node is not None
    assert len(drawn.boxes.node.vertices) == 8 * drawn.boxes.count == 8 * 300
    assert drawn.trunks.node is None
    moving = drawn.moving.node
    assert moving is not None
    live.tick(snap(world=world, truth=truth(boxes(2, x_m=6.5))))
    assert drawn.moving.node is moving
    np.testing.assert_allclose(np.asarray(moving.vertices).reshape(2, 8, 3).mean(axis=1)[:, 0], 6.5)
    live.tick(snap(world=world, truth=truth(boxes(2, x_m=6.5)), age_s=5.0))
    assert drawn.moving.count == 0 and not moving.visible


def test_a_navigations_goal_stands_where_the_simulator_says_and_a_chase_has_none(live: Live, snap: Make) -> None:
    chased = truth(boxes(0))
    live.tick(snap(truth=chased))
    assert not live.scene.goal.frame.visible
    live.tick(snap(truth=replace(chased, goal_world_3=np.array([90.0, 1.0, -0.5]))))
    assert live.scene.goal.frame.visible
    np.testing.assert_allclose(live.scene.goal.frame.position, [90.0, 1.0, -0.5])


def test_a_broken_picture_changes_nothing(live: Live, snap: Make) -> None:
    live.tick(snap(preview=PreviewView(seq=1, stamp_ns=1, width=160, height=96, picture=b"not a jpeg")))
    live.tick(snap(preview=PreviewView(seq=2, stamp_ns=2, width=160, height=96, picture=b"\xff\xd8\xff\xe0broken")))
    assert live.scene.frustum.image is None
    np.testing.assert_allclose(live.scene.vehicle.position, [10.0, 0.0, 2.0])


def test_a_busy_port_is_an_error_and_not_another_port(live: Live, snap: Make) -> None:
    taken = urlsplit(live.dashboard.url).port
    assert taken is not None
    with pytest.raises(PortBusyError, match=str(taken)):
        gate(taken)


def test_an_empty_snapshot_can_be_shown(live: Live, snap: Make) -> None:
    live.tick(Snapshot(now_s=1.0, vehicle="goshawk", endpoint="tcp/x:1", linked=False, alive=False))
    assert not live.scene.vehicle.visible


def test_the_last_pose_of_a_silent_vehicle_is_a_ghost(live: Live, snap: Make) -> None:
    live.tick(snap())
    assert live.scene.model.visible
    assert not live.scene.ghost.visible
    live.tick(snap(age_s=3.0))
    assert not live.scene.model.visible
    assert live.scene.ghost.visible
    assert live.scene.vehicle.visible


def test_detections_stand_beside_the_estimate_and_weak_ones_are_left_out(live: Live, snap: Make) -> None:
    base = snap()
    assert base.plan is not None
    seen_N3 = np.tile([14.0, 1.0, 1.0], (15, 1)) + 0.1 * np.arange(15)[:, None]
    objectness_N = np.where(np.arange(15) == 7, 0.9, 0.01)
    live.tick(replace(base, plan=replace(base.plan, target_pos_world_N3=seen_N3, objectness_N=objectness_N)))
    np.testing.assert_allclose(live.scene.detections.pos_B3, seen_N3[7:8])
    live.tick(snap(age_s=3.0))
    assert live.scene.detections.count == 0


def test_the_vehicle_asked_for_is_shown_and_the_other_leaves_the_scene(snap: Make) -> None:
    live = Live(watched("alpha", snap), watched("bravo", snap))
    try:
        quiet = Snapshot(now_s=100.0, vehicle="bravo", endpoint="tcp/x:1", linked=False, alive=False)
        live.tick(snap(vehicle="alpha"), quiet)
        assert live.scene.vehicle.visible
        live.panels.show(1)
        live.tick(snap(vehicle="alpha"), quiet)
        assert not live.scene.vehicle.visible
        assert not live.scene.chosen.node.visible
    finally:
        live.dashboard.close()


def test_a_plan_is_drawn_anew_though_another_vehicles_had_its_number(snap: Make) -> None:
    live = Live(watched("alpha", snap), watched("bravo", snap))
    try:
        one, other = snap(vehicle="alpha"), snap(vehicle="bravo")
        assert other.plan is not None
        start_3 = other.plan.start_pos_world_3 + np.array([0.0, 50.0, 0.0])
        other = replace(other, plan=replace(other.plan, start_pos_world_3=start_3))
        live.tick(one, other)
        live.panels.show(1)
        live.tick(one, other)
        assert live.scene.candidates.root.visible
        np.testing.assert_allclose(live.scene.candidates.root.position, start_3)
    finally:
        live.dashboard.close()


def test_the_camera_of_another_vehicle_does_not_show_the_formers_picture(snap: Make) -> None:
    live = Live(watched("alpha", snap), watched("bravo", snap))
    try:
        seen = snap(vehicle="alpha", preview=preview())
        live.tick(seen, snap(vehicle="bravo"))
        assert live.scene.frustum.image is not None
        live.panels.show(1)
        live.tick(seen, snap(vehicle="bravo"))
        assert live.scene.camera.visible
        assert live.scene.frustum.image is None
    finally:
        live.dashboard.close()


def test_memory_of_the_plots_is_constant(live: Live, snap: Make) -> None:
    base = snap()
    assert base.control is not None
    (feed,) = live.dashboard.feeds
    before = [curves.nbytes for curves in feed.curves]
    for k in range(1500):
        feed.take(replace(base, control=replace(base.control, stamp_ns=k * 50_000_000)))
    assert [curves.nbytes for curves in feed.curves] == before


def test_the_charts_hold_what_was_flown_and_grow_with_it(live: Live, snap: Make) -> None:
    base = snap()
    assert base.control is not None
    charts = live.dashboard.feeds[0].curves[0]
    for k, speed_mps in enumerate((3.0, 3.0, 12.0)):
        fast = replace(base.control, stamp_ns=int(2e9) + k * 50_000_000, vel_world_3=np.array([speed_mps, 0.0, 0.0]))
        live.tick(replace(base, control=fast))
    assert ">15</text>" in charts.charts_html()
    assert "nan" not in charts.charts_html()


def test_start_is_offered_on_the_ground_alone_and_readiness_too(live: Live, snap: Make) -> None:
    base = snap()
    assert base.control is not None and base.health is not None
    ready, fault = replace(base.control, mode=pb.MODE_READY), replace(base.control, mode=pb.MODE_FAULT)
    gui = live.panels
    for control, offered in ((ready, True), (base.control, False), (fault, False), (ready, True)):
        live.tick(replace(base, control=control))
        assert gui.stops(live.dashboard.feeds[0].snap).one == "Stop", "a Stop is always offered"
        assert gui.offers_start is offered
        assert gui.shows_readiness is offered
