"""A recorded instant in 3-D: the live view's own scene, with the way that is flown, what the camera measured, what
another policy would have flown, and a second flight beside or over the first."""

from __future__ import annotations

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
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array, PlanView

SECOND_ROOT = "/second"
SIDE_GAP_M = 12.0
"""Between two flights that are shown side by side."""

SecondMode = Literal["Overlaid", "Side by side", "Hidden"]


@dataclass(frozen=True, kw_only=True)
class ReviewOptions:
    """What the viewer asked to see."""

    view: ViewOptions
    depth: bool
    replay: bool
    second: SecondMode


class ReviewScene:
    """Draws instants of one flight, or of two, into a viewer's scene, on the ground that ``prepare`` made."""

    def __init__(
        self, viewer: Viewer, flight: Flight, replay: Replay | None, second: Flight | None, by_s: float
    ) -> None:
        """The second flight's own time is ``by_s`` less than the first one's."""
        self._viewer = viewer
        self._flight, self._replay, self._second, self._by_s = flight, replay, second, by_s
        self.first = LiveScene(viewer, "/first")
        self._add_way("/first", flight, theme.VEHICLE)
        self.second: LiveScene | None = None
        if second is not None:
            self._second_root = viewer.scene.add_frame(SECOND_ROOT, show_axes=False)
            self.second = LiveScene(viewer, SECOND_ROOT, theme.SECOND, theme.SECOND)
            self._add_way(SECOND_ROOT, second, theme.SECOND)
        self.depth: viser.PointCloudHandle | None = None
        self.replayed = viewer.scene.add_line_segments(
            "/replay/chosen",
            np.zeros((SAMPLES - 1, 2, 3)),
            theme.vivid(theme.REPLAY),
            thickness=5.0,
            thickness_units="screen",
            visible=False,
        )

    def _add_way(self, root: str, flight: Flight, rgb: theme.Rgb) -> None:
        way_N3 = recorded.path_N3(flight)
        if len(way_N3) < 2:
            return
        faint = 0.4 * np.array(theme.vivid(rgb)) + 0.6 * np.array(theme.BACKGROUND)
        self._viewer.scene.add_line_segments(
            f"{root}/way",
            np.stack([way_N3[:-1], way_N3[1:]], axis=1),
            (int(faint[0]), int(faint[1]), int(faint[2])),
            thickness=1.5,
            thickness_units="screen",
        )

    def update(self, snap: Snapshot, replayed: PlanView | None, options: ReviewOptions) -> None:
        """Shows the instant of ``snap``, and what the other policy made of its frame."""
        time_s = snap.now_s
        self.first.retrace(*recorded.trails_at(self._flight, time_s))
        self.first.update(snap, options.view)
        self._draw_depth(time_s, options.depth)
        self._draw_replayed(snap, replayed if options.replay else None)
        if self._second is not None and self.second is not None:
            self._draw_second(self._second, self.second, time_s - self._by_s, options)

    def _draw_depth(self, time_s: float, shown: bool) -> None:
        found = recorded.depth_points(self._flight, time_s) if shown else None
        if found is None:
            if self.depth is not None:
                self.depth.visible = False
            return
        points_P3, colors_P3 = found
        if self.depth is not None:
            self.depth.remove()
        self.depth = self._viewer.scene.add_point_cloud(
            "/depth", points_P3.astype(np.float32), colors_P3, point_size=0.035, point_shape="square"
        )

    def _draw_replayed(self, snap: Snapshot, replayed: PlanView | None) -> None:
        chosen = recorded.only_chosen(replayed)
        self.replayed.visible = chosen is not None and self.first.chosen.visible
        if chosen is not None:
            self.replayed.points = curves.segments_M23(curves.plan_curves_NS3(chosen, SAMPLES)).astype(np.float32)

    def _draw_second(self, flight: Flight, scene: LiveScene, time_s: float, options: ReviewOptions) -> None:
        self._second_root.visible = options.second != "Hidden"
        if options.second == "Hidden":
            return
        beside = options.second == "Side by side"
        self._second_root.position = (0.0, -self._side_m() if beside else 0.0, 0.0)
        snap = recorded.snapshot_at(flight, time_s)
        # Only what it flew: two fans of candidates over each other cannot be read. Its world is drawn where it is seen
        # apart from the first one's.
        snap = replace(snap, plan=recorded.only_chosen(snap.plan), preview=None)
        scene.retrace(*recorded.trails_at(flight, time_s))
        scene.update(snap, replace(options.view, frustum=False, world=options.view.world and beside))

    def _side_m(self) -> float:
        """How far to the south the second flight is moved such that the two do not meet."""
        first_N3, second_N3 = recorded.path_N3(self._flight), recorded.path_N3(self._second or self._flight)
        return _highest_north_m(second_N3) - _lowest_north_m(first_N3) + SIDE_GAP_M


def _highest_north_m(way_N3: Array) -> float:
    return float(way_N3[:, 1].max()) if len(way_N3) else 0.0


def _lowest_north_m(way_N3: Array) -> float:
    return float(way_N3[:, 1].min()) if len(way_N3) else 0.0
