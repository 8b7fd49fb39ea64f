"""What the planner remembers to stand about the vehicle, in the 3-D view: cubes, one batched mesh."""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import shapes
from goshawk_dashboards.scene.batch import Batch
from goshawk_dashboards.state.views import RememberedView

OPACITY = 0.25
"""What lies behind many of them is to be seen, too: the viewer may stand among them."""


class RememberedScene:
    """Draws one vehicle's map."""

    def __init__(self, viewer: Viewer, root: str) -> None:
        """``root`` is the scene node that it is drawn under; empty: the world frame."""
        self._viewer = viewer
        self._drawn: tuple[int, int] | None = None
        self.cubes = Batch(viewer, f"{root}/remembered", shapes.box(), theme.REMEMBERED, opacity=OPACITY)

    def update(self, remembered: RememberedView | None) -> None:
        """Shows a map, drawn once; None: there is none, it is too old, or it is not to be seen."""
        if remembered is None:
            self.cubes.hide()
            self._drawn = None
        elif self._drawn != (remembered.seq, remembered.stamp_ns):
            self._drawn = (remembered.seq, remembered.stamp_ns)
            # The farthest first: what is nearer, and its map is about the vehicle, is drawn over it.
            centre_V3 = remembered.centre_V3[np.argsort(-np.linalg.norm(remembered.centre_V3, axis=1))]
            with self._viewer.atomic():
                # About the origin, as it was sent: a node far out has no rounding then.
                self.cubes.place(centre_V3, np.full_like(centre_V3, remembered.voxel_m))
                if self.cubes.node is not None:
                    self.cubes.node.position = remembered.origin_world_3
