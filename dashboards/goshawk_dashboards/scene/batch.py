"""Many copies of one mesh in the 3-D view, which come, go and move without a new node.

A browser compiles a node's shaders when the node is made, and forgets them with it. Without a graphics card that takes
seconds, and a node made anew each second would leave no time to draw. So a batch keeps its node: it grows rarely, and
copies that are not needed have no size.
"""

from __future__ import annotations

import numpy as np
import trimesh
import viser

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.state.views import Array

UPRIGHT_4 = (1.0, 0.0, 0.0, 0.0)


class Batch:
    """Copies of a mesh, in one colour."""

    def __init__(
        self,
        viewer: Viewer,
        name: str,
        mesh: trimesh.Trimesh,
        color: theme.Rgb,
        *,
        opacity: float | None = None,
        flat: bool = True,
    ) -> None:
        self._scene, self._name, self._mesh, self._color = viewer.scene, name, mesh, color
        self._opacity, self._flat = opacity, flat
        self.node: viser.BatchedMeshHandle | None = None
        self.count = 0
        """How many are shown."""

    def place(self, pos_B3: Array, size_B3: Array, wxyz_B4: Array | None = None) -> None:
        """Shows a copy at each place, of this size along its own axes."""
        self.count = len(pos_B3)
        if self.count == 0:
            self.hide()
            return
        held = 0 if self.node is None else len(self.node.batched_positions)
        room = held if held >= self.count else self.count if held == 0 else max(self.count, 2 * held)
        spare = ((0, room - self.count), (0, 0))
        pos = np.pad(pos_B3, spare, mode="edge")
        size = np.pad(size_B3, spare)
        wxyz = np.tile(UPRIGHT_4, (room, 1)) if wxyz_B4 is None else np.pad(wxyz_B4, spare, mode="edge")
        if self.node is None or room > held:
            self._make(pos, size, wxyz)
        else:
            self.node.batched_positions = pos.astype(np.float32)
            self.node.batched_scales = size.astype(np.float32)
            self.node.batched_wxyzs = wxyz.astype(np.float32)
            self.node.visible = True

    def _make(self, pos: Array, size: Array, wxyz: Array) -> None:
        if self.node is not None:
            self.node.remove()
        self.node = self._scene.add_batched_meshes_simple(
            self._name,
            np.asarray(self._mesh.vertices),
            np.asarray(self._mesh.faces),
            wxyz,
            pos,
            batched_scales=size,
            batched_colors=self._color,
            opacity=self._opacity,
            flat_shading=self._flat,
            lod="off",
            cast_shadow=False,
        )

    def hide(self) -> None:
        """Shows none; the node stays."""
        self.count = 0
        if self.node is not None:
            self.node.visible = False
