"""What a phone shows above the scene without a touch: the state, and the picture in flight or what is not ready."""

from __future__ import annotations

from html import escape

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.html import DIM, TEXT
from goshawk_dashboards.page.status import failing_checks
from goshawk_dashboards.state.snapshot import Snapshot

LINES = 4
"""Checks that fail, of which so many are shown."""


def phone_html(snap: Snapshot, status: str, picture: str) -> str:
    """``status`` is the card of the state, ``picture`` the camera's."""
    return (
        f'<div data-goshawk="phone" class="goshawk-phone">{status}{picture if snap.flying else _readiness(snap)}</div>'
    )


def _readiness(snap: Snapshot) -> str:
    failing = failing_checks(snap)
    lines = "".join(
        f'<div style="color:{theme.css(theme.BAD)}">&#10007; {escape(line)}</div>' for line in failing[:LINES]
    )
    words = lines or f'<div style="color:{theme.css(theme.GOOD)}">&#10003; every check passes</div>'
    where = f'<div style="{DIM}">Start is in the sheet below.</div>' if snap.health is not None else ""
    return f'<div style="{TEXT};padding:2px 12px 8px">{words}{where}</div>'
