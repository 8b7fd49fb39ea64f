"""The simulator's world in the 3-D view: ground, trees, walls, scans, moving obstacles, each kind one batched mesh.

Of trees and walls only those near the vehicle are drawn, and fog hides where they end: a forest of thousands is more
than a laptop's own graphics can draw thirty times a second.
"""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import shapes
from goshawk_dashboards.scene.batch import Batch
from goshawk_dashboards.scene.relief import Relief
from goshawk_dashboards.state.views import Array, BoxesView, WorldView

WALL_OPACITY = 0.4
"""What flies inside a house is to be seen from outside."""
NEAR_M = 35.0
"""Trees and walls farther off than this are not drawn."""
RENEW_M = 6.0
"""The choice of what is near is made anew when the vehicle has flown this far."""
GRID = "/ground"
"""The node of the flat grid, which is drawn where no relief is known."""


class WorldScene:
    """Draws what the simulator says of its world; a real vehicle has none."""

    def __init__(self, viewer: Viewer, root: str = "") -> None:
        """``root`` is the scene node that it is drawn under; empty: the world frame."""
        self._scene = viewer.scene
        self._ground = f"{root}/world/ground"
        self.trunks = Batch(viewer, f"{root}/world/trunks", shapes.trunk(), theme.TRUNK, flat=False)
        self.foliage = Batch(
            viewer, f"{root}/world/foliage", shapes.foliage(), theme.FOLIAGE, opacity=WALL_OPACITY, flat=False
        )
        self.boxes = Batch(viewer, f"{root}/world/boxes", shapes.box(), theme.WALL, opacity=WALL_OPACITY)
        self.moving = Batch(viewer, f"{root}/truth/moving", shapes.box(), theme.vivid(theme.MOVING))
        self._world: WorldView | None = None
        self._about_2: Array | None = None

    def update(self, world: WorldView | None, moving: BoxesView | None, *, shown: bool, about_3: Array | None) -> None:
        """Draws a new world's ground once, what stands about ``about_3`` (None: all), and the moving obstacles where
        they are now; None: there are none."""
        world, moving = (world, moving) if shown else (None, None)
        about_2 = None if about_3 is None else about_3[:2]
        if world is not self._world:
            self._world, self._about_2 = world, about_2
            self._draw_ground(world)
            self._draw_near(world, about_2)
        elif about_2 is not None and (
            self._about_2 is None or float(np.linalg.norm(about_2 - self._about_2)) > RENEW_M
        ):
            self._about_2 = about_2
            self._draw_near(world, about_2)
        _place_boxes(self.moving, moving)

    def _draw_ground(self, world: WorldView | None) -> None:
        relief = None if world is None else Relief(world)
        hilly = relief is not None and relief.known
        grid = self._scene.get_handle_by_name(GRID)
        if grid is not None:
            grid.visible = not hilly
        self._scene.remove_by_name(self._ground)
        if relief is None or not hilly:
            return
        vertices, faces = relief.mesh()
        add = self._scene.add_mesh_simple
        add(
            self._ground, vertices, faces, color=theme.GROUND, material="toon3", cast_shadow=False, receive_shadow=False
        )
        # Of each cell one triangle: its edges and those of its neighbours are all there are.
        lines, half = vertices + (0.0, 0.0, 0.03), faces[: len(faces) // 2]
        add(f"{self._ground}/lines", lines, half, color=theme.GRID_SECTION, wireframe=True, cast_shadow=False)

    def _draw_near(self, world: WorldView | None, about_2: Array | None) -> None:
        boxes = None if world is None else world.boxes
        _place_boxes(self.boxes, boxes if boxes is None or about_2 is None else _near(boxes, about_2))
        self._draw_trees(world, about_2)

    def _draw_trees(self, world: WorldView | None, about_2: Array | None) -> None:
        if world is None or len(world.radius_m_K) == 0:
            self.trunks.hide()
            self.foliage.hide()
            return
        base_K3, top_K3 = world.base_world_K3, world.top_world_K3
        far_K = np.linalg.norm(base_K3[:, :2] - (base_K3[0, :2] if about_2 is None else about_2), axis=1)
        # The farthest first, for their leaves are transparent.
        order_K = np.argsort(-far_K)
        near_K = order_K if about_2 is None else order_K[far_K[order_K] < NEAR_M]
        axis_K3 = top_K3 - base_K3
        wxyz_K4, height_K = shapes.wxyz_from_up_K4(axis_K3), np.linalg.norm(axis_K3, axis=1)
        size_K3 = np.stack([world.radius_m_K, world.radius_m_K, height_K], axis=1)
        leafy_K = near_K[world.foliage_radius_m_K[near_K] > 0.0]
        leaves_K3 = np.repeat(world.foliage_radius_m_K[:, None], 3, axis=1)
        self.trunks.place(base_K3[near_K], size_K3[near_K], wxyz_K4[near_K])
        self.foliage.place(top_K3[leafy_K], leaves_K3[leafy_K], wxyz_K4[leafy_K])


def _near(boxes: BoxesView, about_2: Array) -> BoxesView:
    """Those of which a corner may be near: a wall is long."""
    reach_B = 0.5 * np.linalg.norm(boxes.size_m_B3[:, :2], axis=1)
    near_B = np.linalg.norm(boxes.centre_world_B3[:, :2] - about_2, axis=1) - reach_B < NEAR_M
    return BoxesView(
        centre_world_B3=boxes.centre_world_B3[near_B],
        size_m_B3=boxes.size_m_B3[near_B],
        yaw_rad_B=boxes.yaw_rad_B[near_B],
    )


def _place_boxes(batch: Batch, boxes: BoxesView | None) -> None:
    if boxes is None or len(boxes) == 0:
        batch.hide()
    else:
        batch.place(boxes.centre_world_B3, boxes.size_m_B3, shapes.wxyz_from_yaw_B4(boxes.yaw_rad_B))
