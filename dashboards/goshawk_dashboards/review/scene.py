"""A recorded instant in 3-D: the live view's own scene, with the way that is flown, what the camera measured, what
another policy would have flown, and other flights beside or over the first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser

from goshawk_dashboards.log import recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Replay
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import curves
from goshawk_dashboards.scene.scene import SAMPLES, LiveScene, ViewOptions
from goshawk_dashboards.scene.tubes import Fan, Tube
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array, PlanView

WAY_RADIUS_M, REPLAYED_RADIUS_M, ALTERED_RADIUS_M = 0.015, 0.03, 0.012
"""Of the tubes that a whole way, another policy's choice and an altered planner's candidates are drawn as."""
SIDE_GAP_M = 12.0
"""Between flights that are shown side by side."""
COLORS: tuple[theme.Rgb, ...] = (theme.VEHICLE, theme.SECOND, theme.TARGET, theme.GOOD, theme.DISTURBANCE, theme.REPLAY)
"""By a flight's place among several, in the scene and in the charts."""

OthersMode = Literal["Overlaid", "Side by side", "Hidden"]


@dataclass(frozen=True, kw_only=True)
class ReviewOptions:
    """What the viewer asked to see."""

    view: ViewOptions
    depth: bool
    replay: bool
    others: OthersMode


@dataclass(frozen=True, kw_only=True, eq=False)
class Other:
    """A flight beside the first one."""

    flight: Flight
    scene: LiveScene
    root: viser.FrameHandle


def color_of(place: int) -> theme.Rgb:
    """Of a flight among several."""
    return COLORS[place % len(COLORS)]


class ReviewScene:
    """Draws instants of one flight, or of several, into a viewer's scene, on the ground that ``prepare`` made."""

    def __init__(self, viewer: Viewer, flights: Sequence[Flight], replay: Replay | None) -> None:
        """The others are drawn beside the first of ``flights``."""
        self._viewer = viewer
        self._flight, self._replay = flights[0], replay
        self.first = LiveScene(viewer, "/first")
        self._add_way("/first", self._flight, theme.VEHICLE)
        self.others = tuple(self._other(k, flight) for k, flight in enumerate(flights[1:], start=1))
        self.depth: viser.PointCloudHandle | None = None
        self.replayed = Tube(
            viewer, "/replay/chosen", theme.vivid(theme.REPLAY), samples=SAMPLES, radius_m=REPLAYED_RADIUS_M
        )
        self.altered = Fan(viewer, "/replay/candidates", samples=SAMPLES, radius_m=ALTERED_RADIUS_M)
        """All candidates of what this viewer altered."""

    def _other(self, place: int, flight: Flight) -> Other:
        name, rgb = f"/other{place}", color_of(place)
        root = self._viewer.scene.add_frame(name, show_axes=False)
        scene = LiveScene(self._viewer, name, rgb, rgb)
        self._add_way(name, flight, rgb)
        return Other(flight=flight, scene=scene, root=root)

    def _add_way(self, root: str, flight: Flight, rgb: theme.Rgb) -> None:
        way_N3 = recorded.path_N3(flight)
        if len(way_N3) < 2:
            return
        faint = 0.4 * np.array(theme.vivid(rgb)) + 0.6 * np.array(theme.BACKGROUND)
        color = (int(faint[0]), int(faint[1]), int(faint[2]))
        way = Tube(self._viewer, f"{root}/way", color, samples=len(way_N3), radius_m=WAY_RADIUS_M)
        way.draw(way_N3)
        way.node.visible = True

    def update(
        self,
        snap: Snapshot,
        replayed: PlanView | None,
        options: ReviewOptions,
        by_s: Sequence[float],
        *,
        altered: bool = False,
    ) -> None:
        """Shows the instant of ``snap``, and what another policy made of its frame, or the planner that was altered.

        A flight's own time is less by its ``by_s``.
        """
        time_s = snap.now_s
        self.first.retrace(*recorded.trails_at(self._flight, time_s))
        _update(self.first, snap, options.view)
        self._draw_depth(time_s, options.depth)
        self._draw_replayed(snap, replayed if options.replay or altered else None)
        self._draw_altered(replayed if altered and self.first.chosen.node.visible else None)
        south_m = 0.0
        above_N3 = recorded.path_N3(self._flight)
        for other, later_s in zip(self.others, by_s[1:], strict=True):
            if options.others == "Side by side":
                way_N3 = recorded.path_N3(other.flight)
                south_m += _highest_north_m(way_N3) - _lowest_north_m(above_N3) + SIDE_GAP_M
                above_N3 = way_N3
            self._draw_other(other, time_s - later_s, options, south_m)

    def _draw_depth(self, time_s: float, shown: bool) -> None:
        found = recorded.depth_points(self._flight, time_s) if shown else None
        if found is None or not len(found[0]):
            if self.depth is not None:
                self.depth.visible = False
            return
        points_P3, colors_P3 = found
        # About their middle: viser sends 16 bits, which far out are centimetres.
        about_3 = points_P3.mean(axis=0)
        points_P3 = points_P3 - about_3
        with self._viewer.atomic():
            if self.depth is None or len(self.depth.points) < len(points_P3):
                self.depth = self._viewer.scene.add_point_cloud(
                    "/depth", points_P3.astype(np.float32), colors_P3, point_size=0.035, point_shape="square"
                )
            else:
                # In the same cloud, which does not flicker: as many points as it has, some of them twice.
                count = len(self.depth.points)
                self.depth.points = np.resize(points_P3, (count, 3)).astype(np.float16)
                self.depth.colors = np.resize(colors_P3, (count, 3))
            self.depth.position = about_3
            self.depth.visible = True

    def _draw_replayed(self, snap: Snapshot, replayed: PlanView | None) -> None:
        chosen = recorded.only_chosen(replayed)
        self.replayed.node.visible = chosen is not None and self.first.chosen.node.visible
        if chosen is not None:
            self.replayed.draw(curves.plan_curves_NS3(chosen, SAMPLES)[0])

    def _draw_altered(self, plan: PlanView | None) -> None:
        if plan is None or len(plan.cost_N) == 0:
            self.altered.root.visible = False
            return
        count = len(plan.cost_N)
        curves_NS3 = curves.plan_curves_NS3(plan, SAMPLES) - plan.start_pos_world_3
        colors_N3 = np.tile(np.array(theme.vivid(theme.REPLAY), dtype=np.uint8), (count, 1))
        self.altered.draw(plan.start_pos_world_3, curves_NS3, colors_N3, np.ones(count, dtype=bool))

    def _draw_other(self, other: Other, time_s: float, options: ReviewOptions, south_m: float) -> None:
        other.root.visible = options.others != "Hidden"
        if options.others == "Hidden":
            return
        other.root.position = (0.0, -south_m, 0.0)
        snap = recorded.snapshot_at(other.flight, time_s)
        # Only what it flew: two fans of candidates over each other cannot be read. Its world is drawn where it is seen
        # apart from the first one's.
        snap = replace(snap, plan=recorded.only_chosen(snap.plan), preview=None)
        other.scene.retrace(*recorded.trails_at(other.flight, time_s))
        beside = options.others == "Side by side"
        shown = replace(options.view, frustum=False, depth=False, world=options.view.world and beside)
        _update(other.scene, snap, shown)


def _update(scene: LiveScene, snap: Snapshot, view: ViewOptions) -> None:
    """Where flights are laid over each other, one may not have begun yet: then nothing of it is drawn."""
    scene.update(snap, view)
    if snap.control is None:
        scene.forget()


def _highest_north_m(way_N3: Array) -> float:
    return float(way_N3[:, 1].max()) if len(way_N3) else 0.0


def _lowest_north_m(way_N3: Array) -> float:
    return float(way_N3[:, 1].min()) if len(way_N3) else 0.0
