"""Watches a vehicle: mode, readiness, speed and the plan that it flies, a line a second.

    python examples/watch_telemetry.py --connect tcp/127.0.0.1:7447

`GroundLink` keeps the newest sample of every channel; `snapshot` gives them all at once. It also has `start` and
`press_stop`, which this program leaves alone.
"""

from __future__ import annotations

import contextlib
import sys
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from goshawk_dashboards.state import words
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, GroundLink, LinkError


def line(snap: Snapshot) -> str:
    """What is known now, in a few words."""
    if snap.stale or snap.health is None:
        return "nothing heard"
    said = [words.mode(snap.health.mode if snap.mode is None else snap.mode)]
    missing = [f"{check.name}: {check.reason}" for check in snap.health.checks if not check.ok]
    said += ["not ready: " + "; ".join(missing)] if missing else ["ready"]
    if snap.control is not None and snap.fresh("control"):
        said.append(f"{np.linalg.norm(snap.control.vel_world_3):.1f} m/s")
    if snap.plan is not None and snap.fresh("plan") and snap.plan.chosen is not None:
        said.append(f"candidate {snap.plan.chosen} of {len(snap.plan.cost_N)}")
    if snap.target is not None and snap.fresh("target") and snap.control is not None:
        distance_m = np.linalg.norm(snap.target.pos_world_3 - snap.control.pos_world_3)
        said.append(f"target {distance_m:.1f} m away")
    return ", ".join(said)


def main(
    connect: Annotated[str, typer.Option(help="The vehicle's endpoint.")] = DEFAULT_CONNECT,
    vehicle: Annotated[str, typer.Option(help="The vehicle's name.")] = DEFAULT_VEHICLE,
    identity: Annotated[Path | None, typer.Option(help="Folder of who you are, for tls.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="For how long; absent: until Ctrl-C.")] = None,
) -> None:
    """Print a line a second. Exit status 1 if the vehicle was never heard."""
    begun, heard = time.monotonic(), False
    try:
        link = GroundLink(vehicle=vehicle, connect=connect, identity=identity)
    except LinkError as error:
        sys.exit(f"watch_telemetry.py: {error}")
    with link:
        with contextlib.suppress(KeyboardInterrupt):
            while seconds is None or time.monotonic() - begun < seconds:
                time.sleep(1.0)
                snap = link.snapshot()
                heard = heard or snap.health is not None
                print(line(snap), flush=True)
        if not heard:
            sys.exit(f"watch_telemetry.py: {link.why_silent(time.monotonic() - begun)}")


if __name__ == "__main__":
    typer.run(main)
