"""Do poses, images and map speak of the same world? And if not, which simple mistake of convention would explain it?

A convention is judged by pixels: the measured depth against the depth that the map has along the same ray. Shape
letters: P pixels, F frames, 3 a vector, 33 a matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data.layout import Labels, View
from goshawk_train.data.raymap import RayMap
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

NEAR_M, FAR_M = 0.4, 10.0
"""Measured depth between these is compared: stereo is good there."""
AGREED = 0.7
"""Least score of data that fit their map; those of the simulator reach 0.85 to 1."""
_CLEAR_GAIN = 0.15
_TARGET_M = 0.8
_FLAT_M = 0.4
_FEWEST = 100
_FEWEST_OBSTACLE = 40


def _diagonal(x: float, y: float, z: float) -> F64:
    return np.diag([x, y, z])


@dataclass(frozen=True, kw_only=True)
class Convention:
    """A way to read a data set: world' = world * (poses, target), attitude' = world * attitude * camera."""

    what: str
    """What the data would have to be for it to be right."""
    advice: str
    world_33: F64 = field(default_factory=lambda: np.eye(3))
    camera_33: F64 = field(default_factory=lambda: np.eye(3))
    roll: int = 0
    """By how many places the quaternion's numbers are to be moved."""
    inverse: bool = False
    """Attitudes are cam_from_world."""
    shift: int = 0
    """Row of the labels that belongs to image 0."""
    scale: float = 1.0
    """True millimetres for one unit of depth."""
    along_ray: bool = False
    """Depth is the distance from the lens instead of that along the optical axis."""


_FLIP_YZ = _diagonal(1, -1, -1)
_SWAP_XY = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
_OPTICAL_FROM_FLU = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])

AS_IS = Convention(what="as it is", advice="")


def _units() -> list[Convention]:
    text = "write depth.npy in millimetres"
    found = [("metres", 1000.0), ("centimetres", 10.0), ("tenths of a millimetre", 0.1)]
    out = [Convention(what=f"depth is in {name}", advice=text, scale=scale) for name, scale in found]
    ray = "write the depth along the optical axis (divide by the ray's length)"
    return [*out, Convention(what="depth is the distance from the lens", advice=ray, along_ray=True)]


def _attitudes() -> list[Convention]:
    flu = "write the attitude of a camera with axes forward, left, up"
    enu = "write poses in the map's axes, z up"
    return [
        Convention(what="quaternions are (x, y, z, w)", advice="write qw first", roll=1),
        Convention(what="quaternions are (w, x, y, z) under the heads qx, qy, qz, qw", advice="mend the head", roll=-1),
        Convention(what="attitudes are camera from world", advice="write world from camera", inverse=True),
        Convention(what="the camera's axes are right, down, forward", advice=flu, camera_33=_OPTICAL_FROM_FLU),
        Convention(
            what="the camera's axes are forward, right, down, or the images are upside down",
            advice=flu,
            camera_33=_FLIP_YZ,
        ),
        Convention(
            what="poses have y right and z down (as NED, FRD)", advice=enu, world_33=_FLIP_YZ, camera_33=_FLIP_YZ
        ),
        Convention(
            what="poses have x north, y east, z down and the map x east, y north, z up",
            advice=enu,
            world_33=_SWAP_XY,
            camera_33=_FLIP_YZ,
        ),
    ]


def _mirrors() -> list[Convention]:
    images, map_ = "mirror rgb.npy and depth.npy back", "write environment.ply in the axes of the poses"
    return [
        Convention(what="images are flipped left to right", advice=images, camera_33=_diagonal(1, -1, 1)),
        Convention(what="images are flipped top to bottom", advice=images, camera_33=_diagonal(1, 1, -1)),
        Convention(what="the map's x is flipped", advice=map_, world_33=_diagonal(-1, 1, 1)),
        Convention(what="the map's y is flipped", advice=map_, world_33=_diagonal(1, -1, 1)),
        Convention(
            what="the map's x and y are swapped", advice=map_, world_33=np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
        ),
    ]


def _tilts_and_more() -> list[Convention]:
    out: list[Convention] = []
    for degrees in (*range(-45, 0, 5), *range(5, 50, 5)):
        side = "up" if degrees > 0 else "down"
        what = f"the camera is pitched {side} by about {abs(degrees)} deg from the attitudes"
        advice = "write the camera's attitude, not the body's"
        out.append(Convention(what=what, advice=advice, camera_33=geometry.rotation_y(-np.radians(degrees))))
    for shift in (-1, 1):
        what = f"images are one row {'behind' if shift < 0 else 'ahead of'} their labels"
        out.append(Convention(what=what, advice="pair images and rows by number, not by name's order", shift=shift))
    for ratio in (0.6, 0.7, 0.8, 1.25, 1.5):
        what = f"the field of view is wrong: its tangent about {ratio:g} of what dataset.json says"
        advice = "import the images with their true intrinsics"
        out.append(Convention(what=what, advice=advice, camera_33=_diagonal(1, ratio, ratio)))
    return out


ALTERNATIVES = (*_units(), *_attitudes(), *_mirrors(), *_tilts_and_more())


@dataclass(frozen=True, kw_only=True)
class Pixels:
    """Measurements of a scene, spread over some of its frames."""

    frame_P: NDArray[np.int64]
    ray_P3: F64
    """In the camera frame, of unit length along the optical axis."""
    depth_P: F64
    """Units of the file; 0: none."""
    labels: Labels


def spread(frames: Sequence[int], count: int) -> list[int]:
    """At most `count` of some frames, evenly spread."""
    places = np.linspace(0, len(frames) - 1, min(count, len(frames))).round().astype(int)
    return [frames[place] for place in places]


def sample_pixels(
    depth_FHW: NDArray[np.uint16], labels: Labels, view: View, frames: Sequence[int], *, count: int
) -> Pixels:
    """`count` random pixels, always the same, of each of some frames."""
    rays = geometry.pixel_rays(view).reshape(-1, 3)
    pixel = np.random.default_rng(0).integers(0, len(rays), (len(frames), count))
    depth = np.stack([depth_FHW[f].reshape(-1)[p] for f, p in zip(frames, pixel, strict=True)])
    return Pixels(
        frame_P=np.repeat(np.asarray(frames), count),
        ray_P3=rays[pixel.ravel()],
        depth_P=depth.ravel().astype(float),
        labels=labels,
    )


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How well measurements fit the map."""

    score: float
    """Share of pixels within tolerance: of all, or of those on obstacles, whichever is less."""
    median_m: float
    beyond: float
    """Share of pixels beyond tolerance."""
    compared: int


def agreement(raymap: RayMap, pixels: Pixels, convention: Convention = AS_IS) -> Agreement | None:
    """None if too few pixels can be compared. Those on the target are left out: the map does not hold it."""
    labels, row = pixels.labels, pixels.frame_P + convention.shift
    in_range = (row >= 0) & (row < len(labels))
    depth = pixels.depth_P * convention.scale / 1000
    if convention.along_ray:
        depth = depth / np.linalg.norm(pixels.ray_P3, axis=1)
    use = in_range & (depth > NEAR_M) & (depth < FAR_M)
    if use.sum() < max(_FEWEST, 0.05 * len(use)):
        return None
    row, depth = row[use], depth[use]
    world_from_cam = labels.world_from_cam_F33
    if convention.roll:
        world_from_cam = geometry.matrix_from_quaternion(np.roll(labels.quaternion_F4, convention.roll, axis=1))
    if convention.inverse:
        world_from_cam = np.swapaxes(world_from_cam, 1, 2)
    rotation = convention.world_33 @ world_from_cam @ convention.camera_33
    pos = labels.pos_world_F3[row] @ convention.world_33.T
    ray = np.einsum("pij,pj->pi", rotation[row], pixels.ray_P3[use])
    point = pos + depth[:, None] * ray
    target = labels.target_world_F3[row] @ convention.world_33.T
    on_target = labels.has_target_F[row] & (np.linalg.norm((point - target)[:, :2], axis=1) < _TARGET_M)
    pos, ray, point, depth = pos[~on_target], ray[~on_target], point[~on_target], depth[~on_target]
    if len(depth) < _FEWEST:
        return None
    difference = np.abs(raymap.depth(pos, ray) - depth)
    good = (difference <= 0.35 + 0.05 * depth) & raymap.covers(pos)
    standing = np.abs(point[:, 2] - raymap.ground.at(point)) > _FLAT_M
    share = float(good.mean())
    obstacles = float(good[standing].mean()) if standing.sum() >= _FEWEST_OBSTACLE else share
    return Agreement(
        score=min(share, obstacles), median_m=float(np.median(difference)), beyond=1 - share, compared=len(depth)
    )


def explain(
    raymap: RayMap, pixels: Pixels, found: Agreement | None, candidates: tuple[Convention, ...] = ALTERNATIVES
) -> tuple[Convention, Agreement] | None:
    """The convention under which the data agree with the map much better than as they are, if there is one."""
    scored = [(c, agreement(raymap, pixels, c)) for c in candidates]
    known = [(c, a) for c, a in scored if a is not None]
    if not known:
        return None
    best, reached = max(known, key=lambda pair: pair[1].score)
    least = max(AGREED - 0.1, (found.score if found else 0.0) + _CLEAR_GAIN)
    return (best, reached) if reached.score >= least else None
