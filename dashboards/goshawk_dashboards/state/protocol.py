"""Whether vehicle and ground mean the same by what they say: the protocol's count, which the heartbeat carries."""

from __future__ import annotations

from goshawk_proto import PROTOCOL

from goshawk_dashboards.state.views import HealthView


def mismatch(health: HealthView | None) -> str:
    """One line if only Stop may be sent to this vehicle; empty: they match, or no heartbeat has come yet."""
    if health is None or health.protocol == PROTOCOL:
        return ""
    older = "vehicle" if health.protocol < PROTOCOL else "ground station"
    return (
        f"only Stop works: {health.vehicle or 'the vehicle'} speaks protocol {health.protocol}, this ground station "
        f"{PROTOCOL}. Update the {older}."
    )
