"""What the planner remembers to stand about the vehicle, in the 3-D view: the outside of its voxels. And what the
camera measured in the last images that were told, fused into one cloud of points."""

from __future__ import annotations

from collections import deque

import numpy as np
import viser
import viser.transforms as tf

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene import shapes
from goshawk_dashboards.scene.batch import Batch
from goshawk_dashboards.state.decode import DEPTH_BLOCKS
from goshawk_dashboards.state.rays import FARTHEST_M, rays_HW3
from goshawk_dashboards.state.views import Array, DepthView, RememberedView

OPACITY = 0.25
"""What lies behind many of them is to be seen, too: the viewer may stand among them."""

FUSED = 4
"""Images that make one cloud: one a second is told."""
APART_NS = 5_000_000_000
"""Images farther apart are not of one place."""
SPARE_M = 50_000.0
"""Below the lens, where nothing is drawn."""
POINT_M = 0.02
"""Edge of a drawn point: larger ones hide the candidates from a camera that follows."""
COLORS_N3 = np.repeat(
    np.linspace(theme.DEPTH, theme.REJECTED, FUSED + 1)[:FUSED].astype(np.uint8),
    DEPTH_BLOCKS[0] * DEPTH_BLOCKS[1],
    axis=0,
)
"""Of a cloud's points, the newest image first."""
TARGET_M = 0.8
"""What was measured this near to the target's axis is left out: it will not be there."""


class FusedDepth:
    """Draws what the camera measured, the older the fainter."""

    def __init__(self, viewer: Viewer, name: str) -> None:
        self._viewer, self._name = viewer, name
        self._images: deque[tuple[int, Array]] = deque(maxlen=FUSED)
        """The stamp of each, and its points in the world."""
        self.node: viser.PointCloudHandle | None = None

    def update(self, depth: DepthView | None, target_3: Array | None) -> None:
        """Takes an image in; None: there is none, or none is to be seen. The target is at ``target_3``, if known."""
        if depth is None:
            self._images.clear()
            if self.node is not None:
                self.node.visible = False
            return
        last_ns = self._images[-1][0] if self._images else None
        if depth.frame_ns == last_ns:
            return
        if last_ns is not None and not 0 < depth.frame_ns - last_ns < APART_NS:
            self._images.clear()  # it was started anew, or a reviewer has jumped
        self._images.append((depth.frame_ns, points_world_P3(depth, target_3)))
        self._draw(depth.cam_world_3, tf.SO3(depth.world_from_cam_4).as_matrix()[:, 0].astype(np.float64))

    def _draw(self, about_3: Array, ahead_3: Array) -> None:
        # What the lens has passed is left out: a camera that follows flies among it, and each point hides much there.
        seen = [points_P3[(points_P3 - about_3) @ ahead_3 > 0.0] for _, points_P3 in reversed(self._images)]
        if not any(map(len, seen)):
            if self.node is not None:
                self.node.visible = False
            return
        # Always as many points in the same colours, those to spare out of sight: viser makes the shaders of a cloud
        # anew when its colours change, which takes a browser longer than a picture.
        points_FP3 = np.tile(about_3 - (0.0, 0.0, SPARE_M), (FUSED, DEPTH_BLOCKS[0] * DEPTH_BLOCKS[1], 1))
        for points_P3, slot_P3 in zip(seen, points_FP3, strict=False):
            slot_P3[: len(points_P3)] = points_P3
        # About the lens: a node far out has no rounding then.
        points_N3 = points_FP3.reshape(-1, 3) - about_3
        with self._viewer.atomic():
            if self.node is None:
                self.node = self._viewer.scene.add_point_cloud(
                    self._name, points_N3.astype(np.float32), COLORS_N3, point_size=POINT_M, point_shading="flat"
                )
            else:
                self.node.points = points_N3.astype(np.float16)
            self.node.position = about_3
            self.node.visible = True


def points_world_P3(depth: DepthView, target_3: Array | None) -> Array:
    """What it measured, in the world frame, without the target."""
    seen_HW = (depth.nearest_m_HW > 0.0) & (depth.nearest_m_HW < FARTHEST_M)
    height, width = depth.nearest_m_HW.shape
    rays = rays_HW3(height, width, depth.hfov_rad, depth.vfov_rad)
    cam_P3 = (rays * depth.nearest_m_HW[..., None])[seen_HW]
    world_P3 = cam_P3 @ tf.SO3(depth.world_from_cam_4).as_matrix().T + depth.cam_world_3
    if target_3 is None:
        return world_P3
    return world_P3[np.linalg.norm(world_P3[:, :2] - target_3[:2], axis=1) > TARGET_M]


def surface(remembered: RememberedView) -> tuple[Array, Array]:
    """The faces of its voxels (one at least) that no other covers, m from the origin: their middles, and where they
    face."""
    cells_V3 = remembered.cells_V3.astype(np.intp) + 1
    taken = np.zeros(tuple(cells_V3.max(axis=0) + 2), dtype=bool)
    taken[tuple(cells_V3.T)] = True
    middles, outward = list[Array](), list[Array]()
    for out_3 in np.concatenate([np.eye(3, dtype=np.intp), -np.eye(3, dtype=np.intp)]):
        bare_V = ~taken[tuple((cells_V3 + out_3).T)]
        middles.append(remembered.centre_V3[bare_V] + 0.5 * remembered.voxel_m * out_3)
        outward.append(np.broadcast_to(out_3.astype(np.float64), (int(bare_V.sum()), 3)))
    return np.concatenate(middles), np.concatenate(outward)


class RememberedScene:
    """Draws one vehicle's map."""

    def __init__(self, viewer: Viewer, root: str) -> None:
        """``root`` is the scene node that it is drawn under; empty: the world frame."""
        self._viewer = viewer
        self._drawn: tuple[int, int] | None = None
        self.faces = Batch(viewer, f"{root}/remembered", shapes.square(), theme.REMEMBERED, opacity=OPACITY)

    def update(self, remembered: RememberedView | None) -> None:
        """Shows a map, drawn once; None: there is none, it is too old, or it is not to be seen."""
        if remembered is None or len(remembered.cells_V3) == 0:
            self.faces.hide()
            self._drawn = None
        elif self._drawn != (remembered.seq, remembered.stamp_ns):
            self._drawn = (remembered.seq, remembered.stamp_ns)
            middle_F3, out_F3 = surface(remembered)
            # The farthest first: what is nearer, and the map is about the vehicle, is drawn over it.
            order_F = np.argsort(-np.linalg.norm(middle_F3 - middle_F3.mean(axis=0), axis=1))
            size_F3 = np.full_like(middle_F3, remembered.voxel_m)
            with self._viewer.atomic():
                # About the origin, as it was sent: a node far out has no rounding then.
                self.faces.place(middle_F3[order_F], size_F3, shapes.wxyz_from_up_K4(out_F3[order_F]))
                if self.faces.node is not None:
                    self.faces.node.position = remembered.origin_world_3
