"""What the browser tests act on: a page that is watched, and a ground station with its vehicles."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass, field

from goshawk_dashboards.live.dashboard import LiveDashboard
from goshawk_ground.link import GroundLink
from playwright.sync_api import Page

Vehicle = tuple[subprocess.Popen[str], GroundLink]
"""A stand-in vehicle, and a link to it."""


@dataclass(kw_only=True)
class Seen:
    """A page and what it did behind the scenes."""

    page: Page
    requests: list[str] = field(default_factory=list[str])
    errors: list[str] = field(default_factory=list[str])
    """What its scripts threw, and what stands in its console as an error."""


@dataclass(kw_only=True)
class Ground:
    """A stand-in vehicle, and a ground station in this process so that its scene can be read."""

    vehicle: subprocess.Popen[str]
    link: GroundLink
    dashboard: LiveDashboard
    others: list[tuple[subprocess.Popen[str], GroundLink]] = field(
        default_factory=list[tuple[subprocess.Popen[str], GroundLink]]
    )
    """Further vehicles of the same dashboard, and their links."""
