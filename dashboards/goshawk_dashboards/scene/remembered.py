"""What the planner remembers to stand about the vehicle, in the 3-D view: cubes, one batched mesh."""

from __future__ import annotations

import numpy as np
import viser

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import shapes
from goshawk_dashboards.state.views import RememberedView

OPACITY = 0.25
"""What lies behind many of them is to be seen, too: the viewer may stand among them."""


class RememberedScene:
    """Draws one vehicle's map."""

    def __init__(self, viewer: Viewer, root: str) -> None:
        """``root`` is the scene node that it is drawn under; empty: the world frame."""
        self._viewer = viewer
        self._name = f"{root}/remembered"
        self._drawn: tuple[int, int] | None = None
        self.cubes: viser.BatchedMeshHandle | None = None

    def update(self, remembered: RememberedView | None) -> None:
        """Shows a map, drawn once; None: there is none, it is too old, or it is not to be seen."""
        if remembered is None or len(remembered.cells_V3) == 0:
            self._clear()
        elif self._drawn != (remembered.seq, remembered.stamp_ns):
            with self._viewer.atomic():
                self._clear()
                self._draw(remembered)

    def _clear(self) -> None:
        if self.cubes is not None:
            self.cubes.remove()
        self.cubes = self._drawn = None

    def _draw(self, remembered: RememberedView) -> None:
        self._drawn = (remembered.seq, remembered.stamp_ns)
        cube, count = shapes.box(), len(remembered.cells_V3)
        self.cubes = self._viewer.scene.add_batched_meshes_simple(
            self._name,
            cube.vertices,
            cube.faces,
            shapes.wxyz_from_yaw_B4(np.zeros(count)),
            remembered.centre_V3,
            batched_scales=np.full(count, remembered.voxel_m),
            batched_colors=theme.REMEMBERED,
            opacity=OPACITY,
            flat_shading=True,
            lod="off",
            cast_shadow=False,
            position=remembered.origin_world_3,
        )
