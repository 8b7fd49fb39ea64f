"""What makes no sense is refused at the edge, in one line; nothing from outside can do worse than that."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import recordings as rec
from google.protobuf.message import DecodeError
from goshawk_dashboards.state import decode, words
from goshawk_proto import goshawk_pb2 as pb
from hypothesis import given
from hypothesis import strategies as st

UNIT = pb.Quat(w=1.0)


def a_plan(candidates: int = 15) -> pb.Plan:
    plan = pb.Plan(seq=4, duration_s=1.5, alpha=0.5, world_from_cam=pb.Quat(w=2.0))
    for k in range(candidates):
        plan.candidates.add(
            end_pos_world=pb.Vec3f(x=k, y=1, z=2), cost=k, rejection=pb.REJECTION_GATE, target_pos_world=pb.Vec3f(x=1)
        )
    return plan


def test_a_plan_keeps_its_candidates_in_order() -> None:
    plan = a_plan()
    plan.chosen = 3
    seen = decode.plan(plan)
    np.testing.assert_array_equal(seen.end_pos_world_N3[:, 0], np.arange(15))
    assert seen.rejections == (pb.REJECTION_GATE,) * 15
    assert seen.chosen == 3
    assert seen.target_pos_world_N3 is not None
    np.testing.assert_allclose(seen.world_from_cam_4, [1, 0, 0, 0])


def test_an_unset_choice_and_unset_detections_are_absent() -> None:
    plan = a_plan()
    plan.candidates[2].ClearField("target_pos_world")
    seen = decode.plan(plan)
    assert seen.chosen is None
    assert seen.target_pos_world_N3 is None


def test_what_was_learnt_in_flight_is_absent_from_a_vehicle_that_does_not_send_it() -> None:
    known = decode.control(pb.Control(world_from_body=UNIT, hover_thrust=0.3, attitude_lag_s=0.08))
    assert (known.hover_thrust, known.attitude_lag_s) == (0.3, 0.08)
    older = decode.control(pb.Control(world_from_body=UNIT))
    assert (older.hover_thrust, older.attitude_lag_s) == (None, None)


def _with(message: Any, **fields: Any) -> Any:
    for name, value in fields.items():
        if hasattr(value, "DESCRIPTOR"):
            getattr(message, name).CopyFrom(value)
        else:
            setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    ("read", "message", "words"),
    [
        (decode.plan, _with(a_plan(), chosen=15), "candidate 15 of 15"),
        (decode.plan, _with(a_plan(), duration_s=0.0), "lasts 0.0 s"),
        (decode.plan, _with(a_plan(), duration_s=math.nan), "lasts nan"),
        (decode.plan, _with(a_plan(), duration_s=1e200), "lasts 1e"),
        (decode.plan, _with(a_plan(), start_vel_world=pb.Vec3(y=-1e200)), "start velocity is beyond 1e"),
        (decode.plan, _with(a_plan(), start_pos_world=pb.Vec3(x=math.inf)), "start position is not finite"),
        (decode.plan, _with(a_plan(), world_from_cam=pb.Quat()), "not a unit quaternion"),
        (decode.plan, a_plan(300), "300 candidates"),
        (decode.control, pb.Control(pos_world=pb.Vec3(z=math.nan), world_from_body=UNIT), "position is not finite"),
        (decode.control, pb.Control(), "not a unit quaternion"),
        (decode.control, pb.Control(world_from_body=UNIT, thrust_n=math.nan), "thrust is not finite"),
        (decode.target, pb.Target(covariance_upper=[1.0] * 36), "36 values"),
        (decode.target, pb.Target(covariance_upper=[math.nan] * 21), "covariance is not finite"),
        (decode.health, pb.Health(rates=[pb.Rate(name="planner", hz=math.inf)]), "rate planner"),
        (decode.preview, pb.Preview(seq=1), "no picture"),
        (decode.truth, pb.SimTruth(clearance_m=math.nan), "clearance"),
        (decode.truth, pb.SimTruth(moving=[pb.SimBox(yaw_rad=math.inf)]), "yaw of a box that moves is not finite"),
        (decode.world, pb.SimWorld(boxes=[pb.SimBox()] * 20_001), "20001 boxes of the world, at most 20000"),
    ],
)
def test_a_message_that_makes_no_sense_is_refused_with_its_reason(
    read: Callable[[Any], Any], message: Any, words: str
) -> None:
    with pytest.raises(decode.MalformedError, match=words):
        read(message)


def test_boxes_keep_their_places_sizes_and_headings_in_order() -> None:
    box = pb.SimBox(centre_world=pb.Vec3f(x=1, y=2, z=3), size_m=pb.Vec3f(x=4, y=5, z=6), yaw_rad=0.5)
    seen = decode.world(pb.SimWorld(boxes=[box, pb.SimBox()])).boxes
    assert len(seen) == 2
    np.testing.assert_array_equal(seen.centre_world_B3, [[1, 2, 3], [0, 0, 0]])
    np.testing.assert_array_equal(seen.size_m_B3, [[4, 5, 6], [0, 0, 0]])
    np.testing.assert_array_equal(seen.yaw_rad_B, [0.5, 0])
    assert len(decode.truth(pb.SimTruth(moving=[box])).moving) == 1
    assert len(decode.truth(pb.SimTruth()).moving) == 0


def test_an_enum_value_from_the_future_is_shown_by_its_number() -> None:
    control = pb.Control.FromString(pb.Control(world_from_body=UNIT).SerializeToString() + b"\x18\x63")
    assert words.mode(decode.control(control).mode) == "99"


def test_modes_and_fallbacks_read_as_words() -> None:
    message = pb.Control(mode=pb.MODE_TRACK, fallback=pb.FALLBACK_HOLD_POSITION, world_from_body=UNIT)
    seen = decode.control(message)
    assert (seen.mode, seen.fallback) == (pb.MODE_TRACK, pb.FALLBACK_HOLD_POSITION)


def test_decoded_arrays_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        decode.control(pb.Control(world_from_body=UNIT)).pos_world_3[0] = 1.0


def test_a_targets_covariance_is_made_whole() -> None:
    cov_66 = decode.target(pb.Target(covariance_upper=range(21))).covariance_66
    assert cov_66 is not None and (cov_66 == cov_66.T).all()
    assert cov_66[0].tolist() == [0, 1, 2, 3, 4, 5]
    assert cov_66[1, 1:].tolist() == [6, 7, 8, 9, 10] and cov_66[5, 5] == 20


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (decode.plan, rec.plan(1.0, 3)),
        (decode.control, rec.control(1.0, 3, 8.0)),
        (decode.target, rec.target(1.0, 3, seen=True)),
        (decode.health, pb.Health(ready=True, rates=[pb.Rate(name="planner", hz=30.0)])),
        (decode.preview, pb.Preview(seq=1, jpeg=b"\xff\xd8")),
        (decode.event, pb.Event(severity=pb.SEVERITY_INFO, text="start accepted")),
        (decode.truth, rec.truth(1.0)),
        (decode.world, pb.SimWorld(boxes=[pb.SimBox(yaw_rad=0.5)])),
    ],
)
@given(twice=st.booleans(), place=st.integers(0, 2**16), gone=st.integers(0, 8), new=st.binary(max_size=8))
def test_a_damaged_message_does_no_worse_than_a_refusal(
    read: Callable[[Any], Any], message: Any, twice: bool, place: int, gone: int, new: bytes
) -> None:
    read(message)
    whole = message.SerializeToString() * (1 + twice)  # twice: its lists are twice as long
    at = place % (len(whole) + 1)
    with contextlib.suppress(DecodeError, decode.MalformedError):
        read(type(message).FromString(whole[:at] + new + whole[at + gone :]))
