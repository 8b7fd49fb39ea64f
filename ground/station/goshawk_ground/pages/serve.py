"""Puts links, radios and the live dashboard together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from goshawk_dashboards.gate import Access, Gate, Tls
from goshawk_dashboards.live.dashboard import LiveDashboard
from goshawk_dashboards.live.feed import Watched
from goshawk_dashboards.state.snapshot import Snapshot

from goshawk_ground.link import GroundLink
from goshawk_ground.link.radio import Radio


def serve_dashboard(
    *links: GroundLink,
    host: str,
    port: int,
    radios: Mapping[str, Radio] | None = None,
    access: Access | None = None,
    tls: Tls | None = None,
) -> LiveDashboard:
    """A running dashboard of the links' vehicles, and of the radios of some of them, by the vehicle's name.

    Raises PortBusyError (an OSError) if the port is taken, UnguardedError (an OSError) for a host that other machines
    reach, without ``tls``.
    """
    gate = Gate(host=host, port=port, access=access or Access(), tls=tls)
    dashboard = LiveDashboard(gate=gate, vehicles=watched(links, radios or {}))
    dashboard.start()
    return dashboard


def watched(links: Sequence[GroundLink], radios: Mapping[str, Radio]) -> list[Watched]:
    """What the dashboard needs of each vehicle."""
    return [_watched(link, radios.get(link.vehicle)) for link in links]


def _watched(link: GroundLink, radio: Radio | None) -> Watched:
    def latest() -> Snapshot:
        snap = link.snapshot()
        return snap if radio is None else replace(snap, autopilot=radio.view())

    return Watched(
        name=link.vehicle,
        latest=latest,
        on_start=link.start,
        on_stop=link.press_stop,
        on_cancel=link.cancel_stop,
    )
