"""The simulator's world in the 3-D view: trees, walls, scans, moving obstacles, each kind one batched mesh."""

from __future__ import annotations

import numpy as np
import viser

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import shapes
from goshawk_dashboards.state.views import BoxesView, WorldView

WALL_OPACITY = 0.4
"""What flies inside a house is to be seen from outside."""


class WorldScene:
    """Draws what the simulator says of its world; a real vehicle has none."""

    def __init__(self, viewer: Viewer, root: str = "") -> None:
        """``root`` is the scene node that it is drawn under; empty: the world frame."""
        self._scene = viewer.scene
        self._root = root
        self._fixed = tuple(f"{root}/world/{what}" for what in ("trunks", "foliage", "boxes"))
        self._world: WorldView | None = None
        self.moving: viser.BatchedMeshHandle | None = None

    def update(self, world: WorldView | None, moving: BoxesView | None, *, shown: bool) -> None:
        """Draws a new world once, and the moving obstacles where they are now; None: there are none."""
        if world is not self._world:
            self._draw(world)
        for name in self._fixed:
            node = self._scene.get_handle_by_name(name)
            if node is not None:
                node.visible = shown
        self._move(moving if shown else None)

    def _draw(self, world: WorldView | None) -> None:
        self._world = world
        for name in self._fixed:
            self._scene.remove_by_name(name)
        if world is None:
            return
        if len(world.radius_m_K) > 0:
            self._add_trees(world)
        if len(world.boxes) > 0:
            self._add_boxes(f"{self._root}/world/boxes", world.boxes, theme.WALL, WALL_OPACITY)

    def _move(self, boxes: BoxesView | None) -> None:
        count = 0 if boxes is None else len(boxes)
        if self.moving is not None and count != len(self.moving.batched_positions):
            self.moving.remove()
            self.moving = None
        if boxes is None or count == 0:
            return
        if self.moving is None:
            self.moving = self._add_boxes(f"{self._root}/truth/moving", boxes, theme.vivid(theme.MOVING))
        # Only places change: an obstacle keeps its size and heading.
        self.moving.batched_positions = boxes.centre_world_B3.astype(np.float32)

    def _add_boxes(
        self, name: str, boxes: BoxesView, color: theme.Rgb, opacity: float | None = None
    ) -> viser.BatchedMeshHandle:
        cube = shapes.box()
        return self._scene.add_batched_meshes_simple(
            name,
            cube.vertices,
            cube.faces,
            shapes.wxyz_from_yaw_B4(boxes.yaw_rad_B),
            boxes.centre_world_B3,
            batched_scales=boxes.size_m_B3,
            batched_colors=color,
            opacity=opacity,
            flat_shading=True,
            lod="off",
            cast_shadow=False,
        )

    def _add_trees(self, world: WorldView) -> None:
        axis_K3 = world.top_world_K3 - world.base_world_K3
        height_K = np.linalg.norm(axis_K3, axis=1)
        wxyz_K4 = shapes.wxyz_from_up_K4(axis_K3)
        trunk = shapes.trunk()
        self._scene.add_batched_meshes_simple(
            f"{self._root}/world/trunks",
            trunk.vertices,
            trunk.faces,
            wxyz_K4,
            world.base_world_K3,
            batched_scales=np.stack([world.radius_m_K, world.radius_m_K, height_K], axis=1),
            batched_colors=theme.TRUNK,
            lod="off",
            cast_shadow=False,
        )
        leafy_K = world.foliage_radius_m_K > 0.0
        if leafy_K.any():
            ball = shapes.foliage()
            self._scene.add_batched_meshes_simple(
                f"{self._root}/world/foliage",
                ball.vertices,
                ball.faces,
                wxyz_K4[leafy_K],
                world.top_world_K3[leafy_K],
                batched_scales=world.foliage_radius_m_K[leafy_K],
                batched_colors=theme.FOLIAGE,
                opacity=0.4,
                flat_shading=True,
                lod="off",
                cast_shadow=False,
            )
