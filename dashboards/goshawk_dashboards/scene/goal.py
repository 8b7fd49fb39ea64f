"""A navigation's goal in the 3-D view: a pole on the ground, with its name."""

from __future__ import annotations

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import shapes
from goshawk_dashboards.state.views import TruthView

POLE_M = 3.0
"""It is seen over what grows about it."""


class GoalScene:
    """Draws where a navigation leads; who chases has none."""

    def __init__(self, viewer: Viewer, root: str) -> None:
        """``root`` is the scene node that it is drawn under; empty: the world frame."""
        scene, mesh = viewer.scene, shapes.trunk()
        self.frame = scene.add_frame(f"{root}/goal", show_axes=False, visible=False)
        scene.add_mesh_simple(
            f"{root}/goal/pole",
            mesh.vertices * (0.08, 0.08, POLE_M),
            mesh.faces,
            color=theme.vivid(theme.TARGET),
            cast_shadow=False,
        )
        scene.add_icosphere(
            f"{root}/goal/knob", radius=0.3, color=theme.vivid(theme.TARGET), position=(0.0, 0.0, POLE_M)
        )
        scene.add_label(f"{root}/goal/label", "goal", position=(0.0, 0.0, POLE_M + 0.6))

    def update(self, truth: TruthView | None) -> None:
        """Shows the goal that the simulator tells of, if it does."""
        goal_3 = None if truth is None else truth.goal_world_3
        self.frame.visible = goal_3 is not None
        if goal_3 is not None:
            self.frame.position = goal_3
