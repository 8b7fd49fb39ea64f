"""A flight by a program: waits until the vehicle is ready, starts it, watches it, stops it, and keeps what was heard.

    python examples/fly.py --connect tcp/127.0.0.1:7447 --seconds 20 --record flight.mcap

Ctrl-C stops the vehicle too. A pilot with the radio in hand stands by, as for every flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from goshawk import RefusedError, Vehicle, VehicleError
from goshawk_dashboards.state import words


async def watch(vehicle: Vehicle) -> None:
    """Prints a line a second for as long as the vehicle flies."""
    async for snap in vehicle.watch(hz=1.0):
        if snap.mode is not None and snap.control is not None and snap.fresh("control"):
            print(f"{words.mode(snap.mode)}, {np.linalg.norm(snap.control.vel_world_3):.1f} m/s", flush=True)
            if not snap.flying:
                return


async def fly(vehicle: Vehicle, profile: str, seconds: float) -> None:
    """From ready to the end of the flight."""
    await vehicle.ready()
    flies = True  # until it is refused: a Start may have been heard though its answer was not
    try:
        print((await vehicle.start(profile)).text, flush=True)
        await vehicle.until(lambda s: s.flying, 10.0)
        with contextlib.suppress(TimeoutError):  # until it has ended by itself, or its time is over
            await asyncio.wait_for(watch(vehicle), seconds)
    except RefusedError:
        flies = False
        raise
    finally:
        if flies:
            print((await vehicle.stop()).text, flush=True)
    await vehicle.until(lambda s: not s.flying, 60.0)


async def run(name: str, connect: str, profile: str, seconds: float, record: Path | None) -> None:
    """The flight, with a recording beside it if one is asked for."""
    async with Vehicle.connect(name, at=connect) as vehicle:
        recording = asyncio.create_task(vehicle.record(record)) if record else None
        try:
            await fly(vehicle, profile, seconds)
        finally:
            if recording:
                recording.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await recording


def main(
    connect: Annotated[str, typer.Option(help="The vehicle's endpoint.")] = "tcp/127.0.0.1:7447",
    vehicle: Annotated[str, typer.Option(help="The vehicle's name.")] = "goshawk",
    profile: Annotated[str, typer.Option(help="A start profile of its vehicle file; empty: its default.")] = "",
    seconds: Annotated[float, typer.Option(min=1.0, help="Then it is stopped.")] = 20.0,
    record: Annotated[Path | None, typer.Option(help="A new log of what is heard.")] = None,
) -> None:
    """Fly once. Exit status 1 if it was refused or not heard."""
    if record is not None and record.exists():
        sys.exit(f"fly.py: {record} is there already: give --record a new name")
    try:
        asyncio.run(run(vehicle, connect, profile, seconds, record))
    except (VehicleError, OSError) as error:
        sys.exit(f"fly.py: {error}")


if __name__ == "__main__":
    typer.run(main)
