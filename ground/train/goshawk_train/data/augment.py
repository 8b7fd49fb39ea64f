"""Image augmentation in torch: colour, noise, blanked channels, mirror. Shape letters: B, H, W, 3 (R, G, B) or 4."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from goshawk_train.config import AugmentConfig

# Luma and two chroma axes (YIQ): a turn in the chroma plane is a turn of hue, its length saturation, luma value.
_YIQ = np.array([[0.299, 0.587, 0.114], [0.5959, -0.2746, -0.3213], [0.2115, -0.5227, 0.3112]])
_RGB = np.linalg.inv(_YIQ)


@dataclass(frozen=True, kw_only=True)
class Jitter:
    """What is done to the colours of each image, [count]: hue turn, rad, and the gains of saturation and value."""

    hue: NDArray[np.float64]
    saturation: NDArray[np.float64]
    value: NDArray[np.float64]

    def of(self, part: slice) -> Jitter:
        """What is done to some of the images."""
        return Jitter(hue=self.hue[part], saturation=self.saturation[part], value=self.value[part])


def draw_jitter(rng: np.random.Generator, count: int, config: AugmentConfig) -> Jitter:
    """Random changes of colour."""
    return Jitter(
        hue=rng.uniform(-config.hue_rad, config.hue_rad, count),
        saturation=1 + rng.uniform(-config.saturation, config.saturation, count),
        value=np.exp(rng.uniform(-config.value, config.value, count)),
    )


def jitter_hsv(rgb_BHW3: Tensor, jitter: Jitter) -> Tensor:
    """The changes in the HSV colour space, as the paper has them; values 0..1."""
    hue, saturation, gain = (
        torch.as_tensor(values, dtype=rgb_BHW3.dtype, device=rgb_BHW3.device)[:, None, None]
        for values in (jitter.hue * (3 / math.pi), jitter.saturation, jitter.value)
    )
    red, green, blue = rgb_BHW3.unbind(-1)
    value, most = rgb_BHW3.max(-1)
    chroma = value - rgb_BHW3.amin(-1)
    ahead = torch.stack([green - blue, blue - red, red - green], -1).gather(-1, most[..., None])[..., 0]
    sextant = ahead / chroma.clamp_min(1e-6) + 2 * most + hue
    value_new = (value * gain).clamp(0, 1)
    chroma_new = value_new * (chroma / value.clamp_min(1e-6) * saturation).clamp(0, 1)
    k = torch.remainder(sextant[..., None] + rgb_BHW3.new_tensor([5.0, 3.0, 1.0]), 6)
    return value_new[..., None] - chroma_new[..., None] * torch.minimum(k, 4 - k).clamp(0, 1)


def colour_matrices(jitter: Jitter) -> NDArray[np.float64]:
    """The changes in YIQ, as linear maps of RGB, [count, 3, 3]: a third of the time of HSV."""
    hue, saturation, value, count = jitter.hue, jitter.saturation, jitter.value, len(jitter.hue)
    turn = np.zeros((count, 3, 3))
    turn[:, 0, 0] = 1
    turn[:, 1, 1] = turn[:, 2, 2] = saturation * np.cos(hue)
    turn[:, 2, 1] = saturation * np.sin(hue)
    turn[:, 1, 2] = -turn[:, 2, 1]
    return value[:, None, None] * (_RGB @ turn @ _YIQ)


def augment(rgbd_BHW4: Tensor, rng: np.random.Generator, config: AugmentConfig, *, count: int, part: slice) -> Tensor:
    """Colour changes and noise on RGB, random blanking of RGB (to black) or depth (to the far end); values 0..1.

    The images are a `part` of the `count` for which is drawn: what happens to one does not depend on the others. The
    mirror is not done here: it changes geometry as well (see `batches.make_batch`).
    """
    device = rgbd_BHW4.device
    out, jitter = torch.empty_like(rgbd_BHW4), draw_jitter(rng, count, config).of(part)
    if config.space == "hsv":
        rgb = jitter_hsv(rgbd_BHW4[..., :3], jitter)
    else:
        matrix = torch.tensor(colour_matrices(jitter), dtype=rgbd_BHW4.dtype, device=device)
        rgb = torch.einsum("bhwi,bji->bhwj", rgbd_BHW4[..., :3], matrix)
    if config.noise > 0:
        # A fresh field for each batch, scaled and rolled for each image: noise is cheap this way.
        seed = int(rng.integers(2**31))
        field = torch.randn((*rgbd_BHW4.shape[1:3], 3), generator=torch.Generator().manual_seed(seed))
        gain = torch.tensor(rng.uniform(0, 2 * config.noise, count)[part], dtype=rgb.dtype, device=device)
        rgb.addcmul_(field.to(device)[None], gain[:, None, None, None])
    out[..., :3] = rgb.clamp_(0, 1)
    out[..., 3] = rgbd_BHW4[..., 3]
    draw = rng.uniform(size=count)[part]
    blank_rgb = torch.tensor(draw < config.blank_rgb, device=device)
    blank_depth = torch.tensor(draw > 1 - config.blank_depth, device=device)
    out[blank_rgb, ..., :3] = 0
    out[blank_depth, ..., 3] = 1
    return out


def hue_of(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angle in the chroma plane of colours [..., 3], rad."""
    yiq = rgb @ _YIQ.T
    return np.arctan2(yiq[..., 2], yiq[..., 1]) % (2 * math.pi)
