"""The instrument panel: numbers as they were sent, a scale that holds what flies, the gate as the filter has it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from goshawk_dashboards.instruments.chart import Line, chart_svg, scale
from goshawk_dashboards.instruments.panel import panel_html
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.state import decode
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import ControlView
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]


def step(snap: Make, k: int, **changes: Any) -> ControlView:
    """A controller step each 50 ms."""
    control = snap().control
    assert control is not None
    return replace(control, seq=k, stamp_ns=1_000_000_000 + 50_000_000 * k, **changes)


@pytest.mark.parametrize(
    ("limit_mps2", "words"), [(6.0, "75 % of 6 m/s&sup2;"), (None, "of a limit that it does not tell")]
)
def test_the_disturbance_is_a_share_of_its_limit_where_the_vehicle_tells_it(
    snap: Make, limit_mps2: float | None, words: str
) -> None:
    push = step(snap, 1, acc_disturbance_world_3=np.array([0.0, 4.5, 0.0]), disturbance_limit_mps2=limit_mps2)
    track = Track()
    track.add(snap(control=push))
    page = panel_html(snap(control=push), track)
    assert words in page
    assert "4.5 m/s&sup2;" in page
    assert "pushes north<" in page


def test_what_the_ground_presses_is_neither_drawn_nor_shown(snap: Make) -> None:
    pressed = np.array([0.0, 0.0, -9.8])
    track = Track()
    for k in range(20):
        track.add(snap(control=step(snap, k, mode=pb.MODE_READY, acc_att_world_3=pressed)))
        track.add(snap(control=step(snap, 20 + k, mode=pb.MODE_TAKEOFF, acc_att_world_3=pressed)))
    standing = snap(control=step(snap, 40, mode=pb.MODE_TAKEOFF, acc_att_world_3=pressed))
    assert "On the ground" in panel_html(standing, track)
    lifted = snap(control=step(snap, 41, mode=pb.MODE_TAKEOFF, pos_world_3=np.array([10.0, 0.0, 2.5])))
    track.add(lifted)
    assert "On the ground" not in panel_html(lifted, track)
    up = track.window(60.0)[1]["commanded up"]
    assert np.isnan(up[:-1]).all() and up[-1] == 0.0


@pytest.mark.parametrize(
    ("time_S", "strokes"), [([0.0, 0.1, 0.2, 5.0, 5.1], 2), ([0.0, 2.0, 4.0, 6.0], 1), ([1.0], 1), ([], 0)]
)
def test_no_line_is_drawn_over_seconds_of_which_nothing_is_known(time_S: list[float], strokes: int) -> None:
    line = Line(label="x", color=(0, 0, 0), values_S=np.ones(len(time_S)))
    drawn = re.findall(r'<path d="([^"]*)" fill="none"', chart_svg("x", np.array(time_S), [line], least=1.0))
    assert sum(path.count("M") for path in drawn) == strokes


def test_a_knock_does_not_blow_the_scale_up() -> None:
    values = np.sin(np.linspace(0.0, 20.0, 400))
    values[200] = 300.0
    low, high, _ = scale([Line(label="x", color=(0, 0, 0), values_S=values)], 0.5, signed=True)
    assert (low, high) == (-1.0, 1.0)


@pytest.mark.parametrize("least", [0.0, -1.0, 1.0, 1e308])
@pytest.mark.parametrize("most", [0.0, 1e-300, 1e308])
def test_no_number_that_a_vehicle_sends_leaves_a_chart_without_a_scale(least: float, most: float) -> None:
    line = Line(label="x", color=(0, 0, 0), values_S=np.array([-most, most, -most, most]))
    for signed in (False, True):
        low, high, step = scale([line], least, signed=signed)
        assert np.isfinite([low, high, step]).all() and low < high and step > 0.0
        drawn = chart_svg("x", np.arange(4.0), [line], least=least, signed=signed)
        assert "nan" not in drawn and "inf" not in drawn


def test_a_gate_that_was_not_sent_is_neither_drawn_nor_named(snap: Make) -> None:
    base = snap()
    assert base.target is not None
    message = pb.Target(look=pb.TargetLook(detections=3, passed=1, gate_sigmas=0.0))
    unsaid = replace(base, target=replace(base.target, look=decode.target(message).look))
    track = Track()
    track.add(unsaid)
    text = words_of(panel_html(unsaid, track))
    assert "innovation / gate &ndash; of &ndash;" in text
    assert "the gate is" not in text


def words_of(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))


def test_the_panel_shows_deviations_gate_rival_and_what_is_learnt(snap: Make) -> None:
    track = Track()
    for k in range(3):
        track.add(snap(control=step(snap, k)))
    page = panel_html(snap(), track)
    text = words_of(page)
    assert re.search(r"&sigma; position, m 0.20 0.10 0.30", text)
    assert "innovation, m 0.00 0.20 0.00 0.20" in text
    assert "pass the gate 1 of 3 detections" in text
    assert "0.7 &sigma; of 5 &sigma;" in text
    assert "rival objectness 0.35 of 0.80 needed, 4.0 m off" in text
    assert "the gate is 5" in text
    assert "31.4 %" in text and "84 ms" in text
    assert "nan" not in page


def test_without_a_look_the_gate_is_not_guessed(snap: Make) -> None:
    base = snap()
    assert base.target is not None
    track = Track()
    unseen = replace(base, target=replace(base.target, look=None))
    track.add(unseen)
    text = words_of(panel_html(unseen, track))
    assert "nothing to compare with" in text
    assert "the gate is" not in text and "rival objectness" not in text


def test_a_rival_that_is_not_there_is_none(snap: Make) -> None:
    base = snap()
    assert base.target is not None and base.target.look is not None
    alone = replace(base.target.look, rival_pos_world_3=None, rival_objectness=None, rival_needed=None)
    assert "rival none" in words_of(panel_html(replace(base, target=replace(base.target, look=alone)), Track()))


def test_a_panel_of_nothing_is_drawn_without_numbers(snap: Make) -> None:
    page = panel_html(snap(control=None, target=None, plan=None), Track())
    assert "no controller step yet" in page
    assert "The filter holds no target." in page
    assert "nan" not in page


def test_memory_of_a_track_is_constant(snap: Make) -> None:
    track = Track()
    before = track.nbytes
    for k in range(1000):
        track.add(snap(control=step(snap, k)))
    assert track.nbytes == before
