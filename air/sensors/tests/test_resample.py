"""What goes out is the policy's view: every pixel where it belongs, nothing between near and far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from goshawk_sensors.setup import profile
from goshawk_sensors.setup.errors import CameraError
from goshawk_sensors.setup.profile import Align
from goshawk_sensors.setup.vehicle import Wanted
from goshawk_sensors.view.resample import Resampler
from lenses import d435, lens, rig

WANTED = Wanted(width=160, height=96, hfov_rad=float(np.radians(90.0)), vfov_rad=float(np.radians(61.93)))
CLIP_M = (0.2, 20.0)
GREY = np.full((192, 320, 3), 99, dtype=np.uint8)


def test_a_colour_pixel_is_the_mean_of_the_pixels_under_it() -> None:
    colour = np.random.default_rng(1).integers(0, 256, (192, 320, 3), dtype=np.uint8)
    sent, _ = Resampler(rig(), WANTED, "colour", CLIP_M)(colour, np.full((192, 320), 3000, np.uint16))
    mean = colour.reshape(96, 2, 160, 2, 3).mean(axis=(1, 3))
    assert np.abs(sent - mean).max() <= 0.5


@pytest.mark.parametrize("align", ["colour", "depth"])
def test_no_depth_lies_between_near_and_far(align: Align) -> None:
    depth = np.where(np.random.default_rng(2).random((480, 848)) < 0.5, 1500, 9000).astype(np.uint16)
    one = lens(848, 480, 91.0, 63.0)
    both = replace(rig(), colour=one, depth=one)
    colour = np.zeros((480, 848, 3), np.uint8)
    _, sent = Resampler(both, WANTED, align, CLIP_M)(colour, depth)
    assert set(np.unique(sent).tolist()) == {1500, 9000}


def test_a_hole_smaller_than_our_pixel_is_filled_from_within_it_and_a_larger_one_is_not() -> None:
    one = lens(960, 576, 90.0, 61.93)  # 6 x 6 of its pixels to one of ours
    both = replace(rig(), colour=one, depth=one)
    depth = np.full((576, 960), 4000, np.uint16)
    depth[63, 63] = 0
    depth[120:240, 120:240] = 0
    _, sent = Resampler(both, WANTED, "depth", CLIP_M)(np.zeros((576, 960, 3), np.uint8), depth)
    assert sent[10, 10] == 4000
    assert np.all(sent[20:40, 20:40] == 0)
    assert np.count_nonzero(sent == 0) == 400


def test_what_is_nearer_or_farther_than_the_clip_is_not_measured() -> None:
    depth = np.full((192, 320), 3000, np.uint16)
    depth[:, :100], depth[:, 200:] = 150, 30_000
    _, sent = Resampler(rig(), WANTED, "depth", CLIP_M)(GREY, depth)
    assert np.all(sent[:, :50] == 0) and np.all(sent[:, 100:] == 0) and np.all(sent[:, 50:100] == 3000)


def test_a_depth_step_that_is_not_a_millimetre_is_counted_in_millimetres() -> None:
    fine = replace(rig(), depth_unit_mm=0.1)
    for align in ("depth", "colour"):
        _, sent = Resampler(fine, WANTED, align, CLIP_M)(GREY, np.full((192, 320), 25_000, np.uint16))
        assert np.all(sent == 2500)


def test_depth_is_seen_from_the_colour_lens_and_the_nearest_hides_the_rest() -> None:
    """The depth lens is 10 cm right of the colour's: what is 2 m before it moves 4 of our pixels to the right."""
    depth = np.full((192, 320), 8000, np.uint16)
    depth[:, 158:162] = 2000
    _, sent = Resampler(rig(move_m=(0.1, 0.0, 0.0)), WANTED, "colour", CLIP_M)(GREY, depth)
    row = sent[48]
    assert list(np.flatnonzero(row == 2000)) == [83, 84]
    assert set(np.unique(row).tolist()) == {0, 2000, 8000}


def test_colour_is_looked_up_at_its_depth_from_the_depth_lens() -> None:
    """The same post, painted red: 2 m away it is 8 source pixels to the right in the colour image."""
    depth = np.full((192, 320), 8000, np.uint16)
    depth[:, 158:162] = 2000
    colour = np.full((192, 320, 3), 99, np.uint8)
    colour[:, 166:170] = (255, 0, 0)
    sent, _ = Resampler(rig(move_m=(0.1, 0.0, 0.0)), WANTED, "depth", CLIP_M)(colour, depth)
    assert np.all(sent[:, 79:81] == (255, 0, 0))
    assert np.all(sent[:, 70:79] == 99)


def test_a_turned_lens_sees_what_lies_where_it_looks() -> None:
    """The depth lens looks 10 degrees to the right of the colour's: what is ahead of it is right of the middle."""
    angle = np.radians(10.0)
    turned = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]], dtype=np.float32
    )
    depth = np.zeros((192, 320), np.uint16)
    depth[95:97, 159:161] = 5000
    _, sent = Resampler(replace(rig(), rotation_33=turned), WANTED, "colour", CLIP_M)(GREY, depth)
    columns = np.flatnonzero(sent.any(axis=0))
    assert abs(columns.mean() - (79.5 + 80.0 * np.tan(angle))) <= 1.0
    assert sent.max() == pytest.approx(5000 * np.cos(angle), abs=15)


def test_a_field_that_is_a_little_narrow_goes_out_as_what_it_is() -> None:
    narrow = replace(rig(), depth=lens(320, 192, 89.0, 61.93))
    resampler = Resampler(narrow, WANTED, "depth", CLIP_M)
    assert np.degrees(resampler.hfov_rad) == pytest.approx(89.0)
    assert np.degrees(resampler.vfov_rad) == pytest.approx(61.93)


def test_a_d455_whose_axis_is_off_the_middle_sends_exactly_the_policys_view() -> None:
    """As they are made: then it sees a little less than 90 degrees to both sides of its axis."""
    d455 = profile.load("d455")
    off = replace(lens(*d455.colour.size, 90.0, 65.0), cx=629.5)
    both = replace(rig(), colour=off, depth=lens(*d455.depth.size, 87.0, 58.0))
    assert off.fov_deg[0] < 89.5
    resampler = Resampler(both, WANTED, d455.align, d455.depth.clip_m, rim=d455.rim)
    assert (resampler.hfov_rad, resampler.vfov_rad) == (WANTED.hfov_rad, WANTED.vfov_rad)


@pytest.mark.parametrize(("align", "seen"), [("depth", "87.0"), ("colour", "69.0")])
def test_a_d435_sees_too_little_where_its_rim_is_not_taken(align: Align, seen: str) -> None:
    with pytest.raises(CameraError, match=rf"{align} sees {seen} degrees from left to right, the policy wants 90\.0"):
        Resampler(d435(), WANTED, align, CLIP_M)


def test_beyond_a_narrower_lens_the_colour_repeats_its_border_and_depth_goes_on() -> None:
    """Of the policy's 160 x 96 a D435's colour sees the middle 110 x 62, its depth the middle 152 x 88."""
    colour = np.random.default_rng(3).integers(0, 256, (480, 848, 3), dtype=np.uint8)
    resampler = Resampler(d435(), WANTED, "colour", CLIP_M, rim=True)
    sent, depth = resampler(colour, np.full((480, 848), 3000, np.uint16))
    assert (resampler.hfov_rad, resampler.vfov_rad) == (WANTED.hfov_rad, WANTED.vfov_rad)
    rows, columns = np.arange(96).clip(17, 78), np.arange(160).clip(25, 134)
    assert np.array_equal(sent, sent[np.ix_(rows, columns)])
    assert len(np.unique(sent.reshape(-1, 3), axis=0)) > 0.9 * 110 * 62
    assert np.all(depth[5:91, 5:155] == 3000) and np.all(depth[:, :3] == 0) and np.all(depth[:3] == 0)


def test_a_rim_changes_nothing_for_a_lens_that_sees_enough() -> None:
    wide = replace(rig(), colour=lens(1280, 800, 95.0, 70.0), depth=lens(848, 480, 87.0, 58.0))
    images = np.random.default_rng(4).integers(0, 256, (800, 1280, 3), np.uint8), np.full((480, 848), 900, np.uint16)
    plain, taken = (Resampler(wide, WANTED, "colour", CLIP_M, rim=rim)(*images) for rim in (False, True))
    assert all(np.array_equal(a, b) for a, b in zip(plain, taken, strict=True))


def test_the_share_that_depth_sees_of_a_wider_colour_is_told() -> None:
    wide = replace(rig(), colour=lens(1280, 800, 90.0, 65.0), depth=lens(848, 480, 87.0, 56.5))
    across = np.tan(np.radians(43.5)) * np.tan(np.radians(28.25)) / np.tan(np.radians(30.965))
    assert Resampler(wide, WANTED, "colour", CLIP_M).seen == pytest.approx(across, abs=0.01)
