"""Many copies of one shape in the 3-D view, as one mesh: they come, go and move without a new node.

A browser without a graphics card draws each instance of an instanced mesh by itself and waits for it, so a hundred
trees take longer than the rest of the picture. It also compiles a node's shaders when the node is made, which takes
seconds. So the copies are put together here, the node stays, and copies that are not needed have no size.
"""

from __future__ import annotations

import numpy as np
import trimesh
import viser
import viser.transforms as tf

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.state.views import Array


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
        self._viewer, self._name, self._color = viewer, name, color
        self._corner_V3, self._face_F3 = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        self._opacity, self._flat = opacity, flat
        self._room = 0
        """Copies that the node has corners for."""
        self.node: viser.MeshHandle | None = None
        self.pos_B3: Array = np.zeros((0, 3))
        """Where copies are shown."""

    @property
    def count(self) -> int:
        """How many are shown."""
        return len(self.pos_B3)

    def place(self, pos_B3: Array, size_B3: Array, wxyz_B4: Array | None = None) -> None:
        """Shows a copy at each place, of this size along its own axes. Of transparent ones the first lie behind."""
        if len(pos_B3) == 0:
            self.hide()
            return
        self.pos_B3 = pos_B3
        corner_BV3 = size_B3[:, None] * self._corner_V3
        if wxyz_B4 is not None:
            corner_BV3 = np.einsum("bij,bvj->bvi", tf.SO3(wxyz_B4).as_matrix(), corner_BV3)
        corner_BV3 = corner_BV3 + pos_B3[:, None]
        held = self._room
        if self.count > held:
            self._room = max(self.count, 2 * held)
        spare = np.broadcast_to(pos_B3[-1], (self._room - self.count, len(self._corner_V3), 3))
        vertices = np.concatenate([corner_BV3, spare]).reshape(-1, 3).astype(np.float32)
        with self._viewer.atomic():
            if self.node is None:
                self.node = self._viewer.scene.add_mesh_simple(
                    self._name,
                    vertices,
                    self._faces(),
                    color=self._color,
                    opacity=self._opacity,
                    flat_shading=self._flat,
                    material="standard" if self._flat else "toon5",
                    cast_shadow=False,
                    receive_shadow=False,
                )
            else:
                self.node.vertices = vertices
                if self._room > held:
                    self.node.faces = self._faces()
                self.node.visible = True

    def _faces(self) -> np.ndarray:
        first_B = len(self._corner_V3) * np.arange(self._room)
        return (first_B[:, None, None] + self._face_F3).reshape(-1, 3).astype(np.uint32)

    def hide(self) -> None:
        """Shows none; the node stays."""
        self.pos_B3 = np.zeros((0, 3))
        if self.node is not None:
            self.node.visible = False
