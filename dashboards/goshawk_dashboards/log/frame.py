"""One RGB-D frame of a flight log: decoded when asked for, and its depth as points in the world.

Shape suffixes: H rows, W columns, P points, 3 a vector or RGB, 4 a quaternion (w, x, y, z).
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from numpy.typing import NDArray
from PIL import Image

from goshawk_dashboards.state.decode import MalformedError
from goshawk_dashboards.state.rays import FARTHEST_M, rays_HW3
from goshawk_dashboards.state.views import Array, PreviewView

MAX_PIXELS = 1280 * 960
BROKEN = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)
"""What Pillow raises for a damaged picture, or for one that is made to fill the memory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameView:
    """A frame, still compressed. Its depth is along the optical axis."""

    seq: int
    stamp_ns: int
    """Middle of the exposure, the vehicle's clock."""
    width: int
    height: int
    hfov_rad: float
    vfov_rad: float
    rgb_png: bytes
    depth_png: bytes

    @classmethod
    def of(cls, m: pb.CompressedRgbd) -> FrameView:
        """Raises MalformedError if it has no size that a camera has, or no colour."""
        if not (0 < m.width * m.height <= MAX_PIXELS and m.rgb_png):
            raise MalformedError(f"frame of {m.width} x {m.height} with {len(m.rgb_png)} bytes of colour")
        return cls(
            seq=m.seq,
            stamp_ns=m.stamp_ns,
            width=m.width,
            height=m.height,
            hfov_rad=m.hfov_rad,
            vfov_rad=m.vfov_rad,
            rgb_png=m.rgb_png,
            depth_png=m.depth_png,
        )

    @property
    def preview(self) -> PreviewView:
        """The colour picture as the live view knows it."""
        return PreviewView(
            seq=self.seq, stamp_ns=self.stamp_ns, width=self.width, height=self.height, picture=self.rgb_png
        )

    def rgb_HW3(self) -> NDArray[np.uint8] | None:
        """Colour; None if the PNG is broken."""
        image = self._open(self.rgb_png)
        return None if image is None else np.asarray(image.convert("RGB"))

    def depth_m_HW(self) -> Array | None:
        """Metres along the optical axis, 0 where nothing was measured; None if there is none or the PNG is broken."""
        image = self._open(self.depth_png)
        return None if image is None else np.asarray(image).astype(np.float64) * 1e-3

    def _open(self, data: bytes) -> Image.Image | None:
        try:
            image = Image.open(io.BytesIO(data), formats=["PNG"])
            if image.size != (self.width, self.height):
                return None
            image.load()
        except BROKEN:
            return None
        return image

    def points_cam_P3(self, farthest_m: float = FARTHEST_M) -> tuple[Array, NDArray[np.uint8]] | None:
        """What depth measured nearer than ``farthest_m``, in the camera's FLU; its colours."""
        depth_HW, rgb_HW3 = self.depth_m_HW(), self.rgb_HW3()
        if depth_HW is None or rgb_HW3 is None or depth_HW.ndim != 2:
            return None
        seen_HW = (depth_HW > 0.0) & (depth_HW < farthest_m)
        rays = rays_HW3(self.height, self.width, self.hfov_rad, self.vfov_rad)
        return (rays * depth_HW[..., None])[seen_HW], rgb_HW3[seen_HW]
