"""Curves in the 3-D view, as thin tubes.

viser's own lines are instanced, a segment an instance, which a browser without a graphics card draws one by one:
`batch` tells more. A tube is a plain mesh, thick in metres, so it grows and shrinks with what is about it.
"""

from __future__ import annotations

import numpy as np
import viser

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.state.views import Array

SIDES = 3
"""Of a tube's section: the fewest that can be seen from everywhere."""


def tube_S33(points_S3: Array, radius_S: Array) -> Array:
    """The corners of a tube along these points, a section for each; or of several tubes, as a leading axis."""
    along_S3 = np.gradient(points_S3, axis=-2)
    along_S3 = along_S3 / np.maximum(np.linalg.norm(along_S3, axis=-1, keepdims=True), 1e-9)
    # Across the way and level; where the way is steep, across and eastward, so that no section loses its width.
    steep_S1 = np.abs(along_S3[..., 2:]) > 0.9
    across_S3 = np.cross(along_S3, np.where(steep_S1, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    length_S1 = np.linalg.norm(across_S3, axis=-1, keepdims=True)
    across_S3 = np.where(length_S1 > 1e-9, across_S3 / np.maximum(length_S1, 1e-9), (0.0, 1.0, 0.0))
    above_S3 = np.cross(across_S3, along_S3)
    turn_31 = (2.0 * np.pi * np.arange(SIDES) / SIDES)[:, None]
    out_S33 = np.cos(turn_31) * above_S3[..., None, :] + np.sin(turn_31) * across_S3[..., None, :]
    return points_S3[..., None, :] + radius_S[:, None, None] * out_S33


def tube_faces(samples: int) -> np.ndarray:
    """The triangles between the sections of ``samples`` points; the ends are open."""
    here = SIDES * np.arange(samples - 1)[:, None] + np.arange(SIDES)
    beside = SIDES * np.arange(samples - 1)[:, None] + (np.arange(SIDES) + 1) % SIDES
    pairs = np.stack([here, beside, here + SIDES], -1), np.stack([beside, beside + SIDES, here + SIDES], -1)
    return np.concatenate([pair.reshape(-1, 3) for pair in pairs]).astype(np.uint32)


class Tube:
    """One curve in one colour, hidden until it is drawn."""

    def __init__(
        self, viewer: Viewer, name: str, color: theme.Rgb, *, samples: int, radius_m: float, tapering: bool = False
    ) -> None:
        """``samples`` points; ``tapering``: to nothing at the last one."""
        self.curve_S3: Array = np.zeros((samples, 3))
        """What is drawn."""
        self.radius_S: Array = radius_m * (np.linspace(1.0, 0.0, samples) if tapering else np.ones(samples))
        self.node: viser.MeshHandle = _add(
            viewer, name, np.zeros((SIDES * samples, 3), dtype=np.float32), tube_faces(samples), color
        )

    def draw(self, curve_S3: Array) -> None:
        """Shows a curve in place of the one before."""
        self.curve_S3 = curve_S3
        self.node.vertices = tube_S33(curve_S3, self.radius_S).reshape(-1, 3).astype(np.float32)


class Bundle:
    """Curves in one colour, as one mesh, hidden until it is drawn."""

    def __init__(self, viewer: Viewer, name: str, color: theme.Rgb, *, samples: int, radius_m: float) -> None:
        self._viewer, self._name, self._color = viewer, name, color
        self._radius_S = np.full(samples, radius_m)
        self._room = 0
        """Curves that the node has corners for."""
        self.curves_KS3: Array = np.zeros((0, samples, 3))
        """What is drawn."""
        self.node: viser.MeshHandle | None = None

    def draw(self, curves_KS3: Array) -> None:
        """Shows these curves in place of those before; the node stays, for a new one costs a browser its shaders."""
        self.curves_KS3 = curves_KS3
        count, samples, _ = curves_KS3.shape
        if count == 0:
            if self.node is not None:
                self.node.visible = False
            return
        held, self._room = self._room, max(self._room, count)
        vertices = np.zeros((self._room, SIDES * samples, 3), dtype=np.float32)
        vertices[:count] = tube_S33(curves_KS3, self._radius_S).reshape(count, -1, 3)
        vertices = vertices.reshape(-1, 3)
        if self.node is None:
            self.node = _add(self._viewer, self._name, vertices, self._faces(samples), self._color)
        else:
            self.node.vertices = vertices
            if self._room > held:
                self.node.faces = self._faces(samples)
        self.node.visible = True

    def _faces(self, samples: int) -> np.ndarray:
        first_K = (SIDES * samples * np.arange(self._room))[:, None, None]
        return (first_K + tube_faces(samples)).reshape(-1, 3).astype(np.uint32)


class Fan:
    """Curves that begin at one place, each in its own colour, those of one colour as one mesh."""

    def __init__(self, viewer: Viewer, name: str, *, samples: int, radius_m: float) -> None:
        self._viewer, self._name = viewer, name
        self._samples, self._radius_m = samples, radius_m
        self.root = viewer.scene.add_frame(name, show_axes=False, visible=False)
        self.bundles: dict[theme.Rgb, Bundle] = {}
        """By the colour, as many as there ever were."""

    @property
    def count(self) -> int:
        """How many curves are shown."""
        return sum(len(bundle.curves_KS3) for bundle in self.bundles.values())

    def draw(self, start_3: Array, curves_NS3: Array, colors_N3: np.ndarray, shown_N: np.ndarray) -> None:
        """Shows those of the curves, from ``start_3`` on, that are to be shown."""
        colors = [(int(red), int(green), int(blue)) for red, green, blue in colors_N3]
        for color in dict.fromkeys(colors):
            if color not in self.bundles:
                name = f"{self._name}/{len(self.bundles)}"
                self.bundles[color] = Bundle(self._viewer, name, color, samples=self._samples, radius_m=self._radius_m)
        self.root.position = start_3
        self.root.visible = True
        for color, bundle in self.bundles.items():
            bundle.draw(curves_NS3[[k for k, own in enumerate(colors) if own == color and shown_N[k]]])


def _add(viewer: Viewer, name: str, vertices: np.ndarray, faces: np.ndarray, color: theme.Rgb) -> viser.MeshHandle:
    return viewer.scene.add_mesh_simple(
        name,
        vertices,
        faces,
        color=color,
        side="double",
        material="toon5",
        cast_shadow=False,
        receive_shadow=False,
        visible=False,
    )
