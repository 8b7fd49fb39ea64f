"""What is looked at, by what the machine is for. The link is in `link.py`."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path

from goshawk_ground.doctor import developer, ground, vehicle
from goshawk_ground.doctor.findings import Finding, State
from goshawk_ground.doctor.programs import programs


class Role(StrEnum):
    """What the machine is for."""

    LAPTOP = "laptop"
    """The ground station: the programs matter to the demo alone."""
    VEHICLE = "vehicle"
    DEVELOPER = "developer"
    """A checkout, where all is built."""


def local_findings(role: Role, bin_dir: Path) -> Iterator[Finding]:
    """Everything but the link, in the order of a machine's set-up."""
    yield ground.python()
    yield ground.packages()
    if role is Role.LAPTOP:
        yield from programs(bin_dir, missing=State.NOTE)
        yield ground.optional("rerun-sdk", developer.EXTRAS["rerun-sdk"])
    elif role is Role.VEHICLE:
        yield from vehicle.computer(bin_dir)
    else:
        yield from developer.checkout(bin_dir)
    yield from ground.ports()
