"""Images that teach nothing: black, constant, overexposed, without depth. Shape letters: F frames, P pixels."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data.check.findings import Finding, numbers

_STRIDE = 7
"""Every seventh pixel is looked at; prime to the image's width, so all columns take part."""

_BLACK_MEAN, _BLACK_STD = 8.0, 4.0
_CONSTANT_STD = 2.0
_WHITE_VALUE, _WHITE_SHARE = 250, 0.7
_DEPTH_LEAST_SHARE = 0.005


@dataclass(frozen=True, kw_only=True)
class ImageReport:
    """Findings, and a digest of each image to find copies by (empty where the image is no good anyway)."""

    findings: list[Finding]
    digests: list[str]
    blank_F: NDArray[np.bool_]
    """No depth at all: right where only sky is seen, which the map decides."""


def check_images(scene: str, rgb_FHW3: NDArray[np.uint8], depth_FHW: NDArray[np.uint16]) -> ImageReport:
    """Look at every frame of a scene."""
    count = len(rgb_FHW3)
    some = rgb_FHW3.reshape(count, -1, 3)[:, ::_STRIDE].astype(np.float32)
    spread = some.std(axis=1).mean(axis=1)
    black = (some.mean(axis=(1, 2)) < _BLACK_MEAN) & (spread < _BLACK_STD)
    constant = (spread < _CONSTANT_STD) & ~black
    white = ((some.min(axis=2) >= _WHITE_VALUE).mean(axis=1) > _WHITE_SHARE) & ~constant
    depth = depth_FHW.reshape(count, -1)[:, ::_STRIDE]
    measured = depth > 0
    blank = measured.mean(axis=1) < _DEPTH_LEAST_SHARE
    least = np.where(measured, depth, np.uint16(65535)).min(axis=1)
    flat = ~blank & (least == depth.max(axis=1))
    again = "record or render these frames again, or delete the scene"
    rules = [
        ("image-black", black, "the image is black", again),
        ("image-constant", constant, "the image is one colour", again),
        ("image-overexposed", white, "most of the image is white", "lower the exposure and record again"),
        ("depth-constant", flat, "depth is the same everywhere", "write the measured depth"),
    ]
    findings = [
        Finding(severity="error", kind=kind, where=scene, frames=numbers(mask), what=what, advice=advice)
        for kind, mask, what, advice in rules
        if mask.any()
    ]
    useless = black | constant
    digests = [
        "" if useless[f] else hashlib.blake2b(rgb_FHW3[f].tobytes(), digest_size=12).hexdigest() for f in range(count)
    ]
    return ImageReport(findings=findings, digests=digests, blank_F=blank)
