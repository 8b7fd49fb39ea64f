"""The key table as Python sees it."""

import pytest
import zenoh
from goshawk_proto import ANY_VEHICLE, KEYS, goshawk_pb2, key_expression, parse_key
from hypothesis import given
from hypothesis import strategies as st


def test_a_key_expression_has_prefix_vehicle_and_suffix() -> None:
    assert key_expression("plan", "kite-1") == "goshawk/kite-1/tel/plan"
    assert key_expression("health", ANY_VEHICLE) == "goshawk/*/tel/health"


@pytest.mark.parametrize("vehicle", ["", "**", "a/b", "Kite", "a b", "a$*", "é", "kite\n"])
def test_a_wildcard_slash_or_empty_vehicle_name_is_refused(vehicle: str) -> None:
    with pytest.raises(ValueError, match="vehicle name"):
        key_expression("plan", vehicle)


def test_an_unknown_row_is_a_key_error() -> None:
    with pytest.raises(KeyError):
        key_expression("nothing", "kite")


def test_commands_are_urgent_queries_that_are_answered() -> None:
    for name in ("cmd_start", "cmd_stop"):
        row = KEYS[name]
        assert row.kind == "query"
        assert row.reply is goshawk_pb2.CommandReply
        assert row.priority == zenoh.Priority.REAL_TIME
        assert row.congestion == zenoh.CongestionControl.DROP


def test_every_published_row_has_a_message_and_never_blocks() -> None:
    published = [row for row in KEYS.values() if row.kind == "pub"]
    assert published
    for row in published:
        assert row.message is not None
        assert row.congestion == zenoh.CongestionControl.DROP


@given(st.sampled_from(sorted(KEYS)), st.from_regex(r"[a-z0-9_-]{1,20}", fullmatch=True))
def test_an_expression_parses_back(name: str, vehicle: str) -> None:
    assert parse_key(key_expression(name, vehicle)) == (KEYS[name], vehicle)


@pytest.mark.parametrize("expression", ["goshawk/kite", "goshawk/kite/tel/nothing", "hawk/kite/tel/plan", ""])
def test_an_unknown_expression_does_not_parse(expression: str) -> None:
    assert parse_key(expression) is None


def test_nothing_waits_for_a_weak_link() -> None:
    """What waits holds up all that the vehicle passes on, its images too."""
    assert all(row.congestion == zenoh.CongestionControl.DROP for row in KEYS.values())
