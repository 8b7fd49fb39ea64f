"""Vehicles of other versions are understood as far as it goes, and only Stop is sent to them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest
from goshawk_ground.link import GroundLink
from goshawk_proto import PROTOCOL, goshawk_pb2
from goshawk_proto import goshawk_pb2 as pb

Fakes = Callable[..., Any]


def goshawk(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(("number", "update"), [(0, "vehicle"), (PROTOCOL + 1, "ground station")])
def test_a_vehicle_of_another_protocol_is_only_stopped(fake_vehicle: Fakes, number: int, update: str) -> None:
    endpoint = fake_vehicle("--protocol", str(number)).endpoint
    with GroundLink(connect=endpoint) as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
        refused = link.start()
        assert (refused.refused_here, refused.answered, refused.accepted) == (True, False, False)
        assert f"speaks protocol {number}, this ground station {PROTOCOL}. Update the {update}." in refused.text
        assert link.snapshot().mode == pb.MODE_READY
        assert link.stop().accepted


def test_the_command_line_says_so_in_one_line(fake_vehicle: Fakes) -> None:
    endpoint = fake_vehicle("--protocol", "0").endpoint
    status = goshawk("status", "--connect", endpoint)
    assert status.returncode == 1
    line = status.stdout.splitlines()[0]
    assert line == f"only Stop works: goshawk speaks protocol 0, this ground station {PROTOCOL}. Update the vehicle."
    start = goshawk("start", "--connect", endpoint)
    assert start.returncode == 1
    assert start.stderr.strip() == f"goshawk: start not sent: {line}"
    assert goshawk("stop", "--connect", endpoint).returncode == 0


def test_a_heartbeat_from_before_the_count_has_protocol_0() -> None:
    yesterday = goshawk_pb2.Health(vehicle="goshawk", mode=goshawk_pb2.MODE_READY)
    assert goshawk_pb2.Health.FromString(yesterday.SerializeToString()).protocol == 0


def test_fields_that_nobody_knows_yet_hurt_nothing(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle("--tomorrow").endpoint) as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
        assert link.start().accepted
        tracking = link.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.plan is not None and s.target is not None, 20)
        assert tracking is not None
        assert [c.name for c in tracking.channels if c.malformed] == []
        assert link.stop().accepted
