"""The camera's picture, decoded within bounds."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from goshawk_dashboards.log.frame import BROKEN
from goshawk_dashboards.state.views import PreviewView


def decode_preview(preview: PreviewView) -> np.ndarray | None:
    """The picture as height x width x 3 bytes; None if it is broken or larger than 1280 x 960."""
    try:
        image = Image.open(io.BytesIO(preview.picture), formats=["JPEG", "PNG"])
        if image.width > 1280 or image.height > 960:
            return None
        return np.asarray(image.convert("RGB"))
    except BROKEN:
        return None
