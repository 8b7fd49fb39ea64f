"""The instrument panel: numbers as they were sent, a scale that holds what flies, the gate as the filter has it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from goshawk_dashboards.instruments.chart import Line, scale
from goshawk_dashboards.instruments.detections import seen
from goshawk_dashboards.instruments.panel import panel_html
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.instruments.tuning import Tuning
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import ControlView, PlanView, TargetView
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]
SHIPPED = Path(__file__).resolve().parents[2] / "air/vehicles/tuning.toml"


@pytest.fixture
def tuning() -> Tuning:
    """The shipped one."""
    return Tuning.of_toml(SHIPPED.read_text(encoding="utf-8"))


def step(snap: Make, k: int, **changes: Any) -> ControlView:
    """A controller step each 50 ms."""
    control = snap().control
    assert control is not None
    return replace(control, seq=k, stamp_ns=1_000_000_000 + 50_000_000 * k, **changes)


def sighting(snap: Snapshot, *off_m: float, after_s: float = 0.02, objectness: float = 0.99) -> PlanView:
    """A plan whose first detections are so far north of where the estimate expects the target; the rest see nothing."""
    target = snap.target
    assert snap.plan is not None and target is not None
    expected_3 = target.pos_world_3 + after_s * target.vel_world_3
    where_N3 = np.tile(expected_3, (15, 1))
    sure_N = np.zeros(15)
    for k, off in enumerate(off_m):
        where_N3[k, 1] += off
        sure_N[k] = objectness - 0.01 * k
    return replace(
        snap.plan, frame_ns=target.stamp_ns + round(after_s * 1e9), target_pos_world_N3=where_N3, objectness_N=sure_N
    )


def test_the_shipped_tuning_is_read_and_another_is_not_guessed(tuning: Tuning) -> None:
    assert tuning.disturbance_limit_mps2 is not None
    assert tuning.gate is not None
    assert Tuning.of_toml("") == Tuning.of_toml("[observer]\nalpha1 = 3.0") == Tuning.of_toml("no toml") == Tuning()


def test_the_disturbance_is_a_share_of_its_limit_where_that_is_known(snap: Make, tuning: Tuning) -> None:
    push = step(snap, 1, acc_disturbance_world_3=np.array([0.0, 4.5, 0.0]))
    for known, words in ((tuning, "75 % of 6 m/s&sup2;"), (Tuning(), "limit not known here")):
        track = Track(known)
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


def test_a_knock_does_not_blow_the_scale_up() -> None:
    values = np.sin(np.linspace(0.0, 20.0, 400))
    values[200] = 300.0
    low, high, _ = scale([Line(label="x", color=(0, 0, 0), values_S=values)], 0.5, signed=True)
    assert (low, high) == (-1.0, 1.0)


def test_a_detection_in_the_gate_is_the_innovation_and_one_far_off_the_rival(snap: Make, tuning: Tuning) -> None:
    base = snap()
    assert base.target is not None
    look = seen(base.target, sighting(base, 5.0, 0.2), tuning.gate)
    assert look is not None
    assert (look.count, look.passed) == (2, 1)
    assert look.innovation_world_3 is not None
    np.testing.assert_allclose(look.innovation_world_3, [0.0, 0.2, 0.0], atol=1e-9)
    assert look.rival_m == pytest.approx(5.0)
    assert look.sigmas is not None and 0.0 < look.sigmas < 5.0


def test_an_innovation_counts_less_the_more_doubtful_the_estimate(snap: Make, tuning: Tuning) -> None:
    base = snap()
    assert base.target is not None and base.target.covariance_66 is not None
    plan = sighting(base, 0.5)

    def sigmas(target: TargetView) -> float:
        look = seen(target, plan, tuning.gate)
        assert look is not None and look.sigmas is not None
        return look.sigmas

    doubtful = replace(base.target, covariance_66=100.0 * base.target.covariance_66)
    assert sigmas(doubtful) < sigmas(base.target)


def test_without_tuning_the_gate_is_not_guessed(snap: Make) -> None:
    base = snap()
    assert base.target is not None
    look = seen(base.target, sighting(base, 5.0, 0.2), None)
    assert look is not None
    assert look.passed is None and look.sigmas is None and look.rival_m is None
    assert seen(base.target, sighting(base, 0.2, after_s=2.0), None) is None, "an old estimate predicts nothing"


def flight(snap: Make) -> Iterator[Snapshot]:
    """Two estimates, and a plan after the first."""
    first = snap()
    assert first.target is not None
    yield replace(first, control=step(snap, 1))
    yield replace(
        first,
        control=step(snap, 2),
        plan=replace(sighting(first, 0.2), seq=2),
        target=replace(first.target, stamp_ns=first.target.stamp_ns + 20_000_000),
    )


def test_the_panel_shows_deviations_gate_and_what_is_learnt(snap: Make, tuning: Tuning) -> None:
    snaps = list(flight(snap))
    page = panel_html(snaps[-1], Track.of(snaps, tuning))
    text = re.sub(r"<[^>]+>", " ", page)
    assert re.search(r"σ; position, m\s+0.20\s+0.10\s+0.30".replace("σ", "&sigma"), text)
    assert re.search(r"innovation, m\s+0.00\s+0.20\s+0.00\s+0.20", text)
    assert "1 of 1 detections" in text
    assert "31.4 %" in text and "84 ms" in text
    assert "nan" not in page


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
