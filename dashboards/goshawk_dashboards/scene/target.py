"""The target in the 3-D view: the filter's estimate with its doubt and its way, and, in a simulation, where it is."""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import shapes
from goshawk_dashboards.scene.tubes import Tube
from goshawk_dashboards.state.views import UNSEEN_S, Array, TargetView, TruthView


class TargetScene:
    """Draws estimates of one vehicle's target."""

    def __init__(self, viewer: Viewer, root: str) -> None:
        """``root`` is the scene node that it is drawn under; empty: the world frame."""
        scene = viewer.scene
        color = theme.vivid(theme.TARGET)
        self.frame = scene.add_frame(f"{root}/target", show_axes=False, visible=False)
        self._dot = scene.add_icosphere(f"{root}/target/mean", radius=0.14, color=color, subdivisions=2)
        self._covariance = scene.add_icosphere(
            f"{root}/target/covariance", radius=1.0, color=color, opacity=0.22, subdivisions=2, cast_shadow=False
        )
        self._label = scene.add_label(f"{root}/target/label", "", position=(0.0, 0.0, 1.2))
        self._arrow = scene.add_arrows(
            f"{root}/target/velocity",
            np.zeros((1, 2, 3)),
            color,
            shaft_radius=0.035,
            head_radius=0.09,
            head_length=0.2,
        )
        self._trail = shapes.Trail(spacing_m=0.3)
        self._line = Tube(
            viewer,
            f"{root}/trail/target",
            color,
            samples=shapes.TRAIL_POINTS,
            radius_m=shapes.TRAIL_RADIUS_M,
            tapering=True,
        )
        mesh = shapes.person()
        self._truth = scene.add_mesh_simple(
            f"{root}/truth/target", mesh.vertices, mesh.faces, color=theme.TRUTH, opacity=0.55, visible=False
        )

    def update(self, target: TargetView | None, *, trail: bool) -> None:
        """Shows an estimate; None: there is none, or it is too old to be drawn."""
        self.frame.visible = target is not None
        self._line.node.visible = trail and len(self._trail) > 1
        if target is None:
            return
        self.frame.position = target.pos_world_3
        color = theme.vivid(theme.TARGET) if target.confirmed else theme.STALE
        self._dot.color = color
        self._covariance.color = color
        self._arrow.points = np.array([[np.zeros(3), 0.5 * target.vel_world_3]], dtype=np.float32)
        self._label.text = _words(target)
        self._covariance.visible = target.covariance_66 is not None
        if target.covariance_66 is not None:
            semi_3, wxyz = shapes.ellipsoid(target.covariance_66[:3, :3])
            self._covariance.scale = (float(semi_3[0]), float(semi_3[1]), float(semi_3[2]))
            self._covariance.wxyz = wxyz
        if target.confirmed and self._trail.add(target.pos_world_3):
            self._draw_trail()

    def show_truth(self, truth: TruthView | None) -> None:
        """Where the target really is; None: unknown, or not to be seen."""
        pos_3 = None if truth is None else truth.target_pos_world_3
        self._truth.visible = pos_3 is not None
        if pos_3 is not None:
            self._truth.position = pos_3

    def retrace(self, points_N3: Array) -> None:
        """Where the target has been, oldest first, in place of what was seen here."""
        self._trail.retrace(points_N3)
        self._draw_trail()

    def clear_trail(self) -> None:
        """Forgets where the target has been."""
        self._trail.clear()

    def forget(self) -> None:
        """Shows nothing of what was drawn."""
        self.clear_trail()
        self.frame.visible = self._truth.visible = self._line.node.visible = False

    def _draw_trail(self) -> None:
        self._line.draw(self._trail.points_S3())


def _words(target: TargetView) -> str:
    """They rarely change: labels are costly to redraw, and the figures are in the panel."""
    if not target.confirmed:
        return "target, unconfirmed"
    if target.since_seen_s > UNSEEN_S:
        return f"target, unseen for {target.since_seen_s:.0f} s"
    return "target"
