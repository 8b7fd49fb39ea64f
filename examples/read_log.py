"""Reads a flight log: phases, speeds, and what the planner chose.

    python examples/read_log.py logs/flight.mcap

`Flight` also reads a log that was cut off or damaged, and says what is missing. Its columns are numpy arrays; the names
of channels and fields are in docs/reference/log-channels.md.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from goshawk_dashboards.log.flight import Flight, LogError
from goshawk_dashboards.state import words
from goshawk_proto import goshawk_pb2 as pb


def main(log: Annotated[Path, typer.Argument(help="A flight log.")]) -> None:
    """Print what happened in a flight."""
    try:
        flight = Flight.open(log)
    except LogError as error:
        sys.exit(f"read_log.py: {error}")
    print(f"{log.name}: {flight.duration_s:.1f} s, {flight.completeness}, by {flight.header.vehicle or 'unknown'}")
    for phase in flight.phases:
        print(f"  {phase.start_s:7.2f} to {phase.end_s:7.2f} s  {phase.name}")

    motion = flight.columns("control", ["vel_world"], max_hz=20.0)
    if len(motion):
        speed_mps = np.linalg.norm(motion["vel_world"], axis=1)
        # Before the first odometry there is none.
        print(f"speed: mean {np.nanmean(speed_mps):.1f}, most {np.nanmax(speed_mps):.1f} m/s")

    target = flight.columns("target", ["confirmed", "since_seen_s"], max_hz=20.0)
    if len(target):
        seen = target["confirmed"] & (target["since_seen_s"] < 0.5)
        print(f"target: seen in {100.0 * seen.mean():.0f} % of its records")

    chosen: Counter[int] = Counter()
    for index in range(flight.count("plan")):
        plan = flight.plan(index)
        if plan is not None and plan.chosen is not None:
            chosen[plan.chosen] += 1
    favourites = ", ".join(f"{candidate} ({times} times)" for candidate, times in chosen.most_common(3))
    print(f"plans: {flight.count('plan')}; the candidates flown most: {favourites or 'none'}")
    for event in flight.events:
        if event.severity != pb.SEVERITY_INFO:
            print(f"{words.severity(event.severity)}: {event.text}")


if __name__ == "__main__":
    typer.run(main)
