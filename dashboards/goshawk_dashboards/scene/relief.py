"""The ground's relief, as far as the simulator's world tells it: from where its trees stand.

Every tree's base lies on the ground, and trees stand closer than the hills are long. Between them the nearest ones
decide, each by the inverse of its squared distance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from goshawk_dashboards.state.views import Array, WorldView

NEAREST = 4
"""Trees that decide about one place."""
CELL_M = 4.0
"""Between the nodes of the mesh; a larger world has larger cells."""
MOST_CELLS = 32
"""Along each side of the mesh: it is to be drawn without a graphics card."""


class Relief:
    """Heights of the ground, world frame."""

    def __init__(self, world: WorldView) -> None:
        self._base_K3 = world.base_world_K3

    @property
    def known(self) -> bool:
        """Whether there are trees enough to tell."""
        return len(self._base_K3) >= NEAREST

    def height_M(self, xy_M2: Array) -> Array:
        """At these places; ``known`` must hold."""
        far_MK = ((xy_M2[:, None, :] - self._base_K3[None, :, :2]) ** 2).sum(axis=2)
        nearest_MN = np.argpartition(far_MK, NEAREST - 1, axis=1)[:, :NEAREST]
        weight_MN = 1.0 / (np.take_along_axis(far_MK, nearest_MN, axis=1) + 0.01)
        return (weight_MN * self._base_K3[nearest_MN, 2]).sum(axis=1) / weight_MN.sum(axis=1)

    def mesh(self) -> tuple[Array, NDArray[np.uint32]]:
        """Vertices and faces over the whole world, with a margin of one cell; of each cell's two faces one is in the
        first half."""
        low_2, high_2 = self._base_K3[:, :2].min(axis=0), self._base_K3[:, :2].max(axis=0)
        cell_m = max(CELL_M, float((high_2 - low_2).max()) / MOST_CELLS)
        x, y = (np.arange(low_2[k] - cell_m, high_2[k] + 2 * cell_m, cell_m) for k in range(2))
        xy_M2 = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        # Row by row: all trees against all nodes at once would be much memory.
        height_M = np.concatenate([self.height_M(row) for row in np.array_split(xy_M2, len(y))])
        corner = (np.arange(len(y) - 1)[:, None] * len(x) + np.arange(len(x) - 1)).ravel()
        right, above = corner + 1, corner + len(x)
        faces = np.concatenate([np.stack([corner, right, above], 1), np.stack([right, above + 1, above], 1)])
        return np.column_stack([xy_M2, height_M]), faces.astype(np.uint32)
