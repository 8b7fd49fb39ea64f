"""Whatever has become of a picture's bytes: it is decoded, or it is none."""

from __future__ import annotations

import io
import random
import struct
import zlib

import numpy as np
import pytest
from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.scene.picture import decode_preview
from PIL import Image

PIXELS = np.random.default_rng(0).integers(0, 255, (30, 40, 3), dtype=np.uint8)


def frame_of(png: bytes) -> FrameView:
    """A frame of 40 x 30 whose colour and depth are this file."""
    return FrameView(seq=1, stamp_ns=1, width=40, height=30, hfov_rad=1.5, vfov_rad=1.2, rgb_png=png, depth_png=png)


def png() -> bytes:
    """A sound picture."""
    file = io.BytesIO()
    Image.fromarray(PIXELS).save(file, "PNG")
    return file.getvalue()


def chunk(kind: bytes, body: bytes) -> bytes:
    """A chunk of a PNG file."""
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def bomb() -> bytes:
    """A small file that says it is a picture of 40,000 x 40,000."""
    size = struct.pack(">IIBBBBB", 40_000, 40_000, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


def test_a_sound_picture_is_decoded() -> None:
    frame = frame_of(png())
    np.testing.assert_array_equal(decode_preview(frame.preview), PIXELS)
    np.testing.assert_array_equal(frame.rgb_HW3(), PIXELS)


def test_a_picture_that_would_fill_the_memory_is_none() -> None:
    frame = frame_of(bomb())
    assert decode_preview(frame.preview) is None
    assert frame.rgb_HW3() is None and frame.depth_m_HW() is None


def test_a_picture_of_another_size_is_none_before_its_pixels_are_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    file = io.BytesIO()
    Image.new("RGB", (41, 30)).save(file, "PNG")
    frame = frame_of(file.getvalue())

    def unpacked(_: Image.Image) -> None:
        raise AssertionError("unpacked")

    monkeypatch.setattr(Image.Image, "load", unpacked)
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", unpacked)
    assert frame.rgb_HW3() is None


def test_no_damage_to_a_picture_is_more_than_no_picture() -> None:
    whole, dice = png(), random.Random(1)
    for _ in range(2000):
        data = bytearray(whole)
        for _ in range(dice.choice([1, 2, 5, 20])):
            data[dice.randrange(dice.choice([60, 300, len(data)]))] = dice.randrange(256)
        frame = frame_of(bytes(data))
        for picture in (decode_preview(frame.preview), frame.rgb_HW3()):
            assert picture is None or picture.ndim == 3
