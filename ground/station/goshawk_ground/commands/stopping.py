"""`goshawk stop`: waits until the vehicle confirms, says meanwhile that it has not, and ends with a verdict."""

from __future__ import annotations

import time

import typer
from goshawk_dashboards.state.views import CommandView

from goshawk_ground.link import GroundLink
from goshawk_ground.process.interrupt import interrupted

SAY_EVERY_S = 3.0


def stop_until_confirmed(link: GroundLink, timeout_s: float | None) -> CommandView:
    """What became of a Stop. Gives up at the time given, or where it is interrupted."""
    began_s = time.monotonic()
    said_s = began_s
    with interrupted() as ended:
        pressed = link.press_stop()
        while not link.stop_ended(0.1):
            now_s = time.monotonic()
            if ended.is_set() or (timeout_s is not None and now_s - began_s >= timeout_s):
                link.give_up_stop()
            elif now_s - said_s >= SAY_EVERY_S:
                said_s = now_s
                typer.echo(f"goshawk: stop pending for {now_s - began_s:.0f} s. {link.why_undelivered()}", err=True)
    return link.stop_outcome or pressed
