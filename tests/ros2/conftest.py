"""A bridge of each test's own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from bridge_rig import BridgeRig, VehicleEnd


@pytest.fixture
def bridge(tmp_path: Path) -> Iterator[BridgeRig]:
    """Not started yet; it ends with the test."""
    rig = BridgeRig(tmp_path)
    yield rig
    rig.close()


@pytest.fixture
def vehicle(bridge: BridgeRig) -> Iterator[VehicleEnd]:
    """The vehicle's end of the network."""
    end = VehicleEnd(bridge.rig.zenoh_port)
    yield end
    end.close()
