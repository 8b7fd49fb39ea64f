"""Odometry of your own: publishes on `in/odometry`, as a visual-inertial estimator does.

    python examples/vio_odometry.py --connect tcp/127.0.0.1:7447

The vehicle file must say `odometry = "zenoh"` under `[sensors]`. Replace `estimate` by what your estimator says. Run it
on the vehicle's own computer: odometry from elsewhere is refused.
"""

from __future__ import annotations

import sys
import time
from typing import Annotated

import numpy as np
import typer
import zenoh
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, LinkError, client_config
from goshawk_proto import KEYS, goshawk_pb2, key_expression

Vec3 = goshawk_pb2.Vec3


def estimate(seq: int, rng: np.random.Generator) -> goshawk_pb2.Odometry:
    """Where the vehicle is: world x east, y north, z up; body x forward, y left, z up; SI and radians.

    Here: it stands still, level, its nose to the east, and the estimate trembles a little as a real one does.
    """
    pos, vel, rate = (rng.normal(0.0, sigma, 3) for sigma in (0.001, 0.005, 0.002))
    return goshawk_pb2.Odometry(
        seq=seq,
        stamp_ns=time.monotonic_ns(),  # when the motion was so, not when it was worked out
        pos_world=Vec3(x=pos[0], y=pos[1], z=pos[2]),
        vel_world=Vec3(x=vel[0], y=vel[1], z=vel[2]),
        world_from_body=goshawk_pb2.Quat(w=1.0, x=0.0, y=0.0, z=0.0),
        ang_vel_body=Vec3(x=rate[0], y=rate[1], z=rate[2]),
        reset_counter=0,  # one more whenever the estimate jumps on purpose, as after a loop closure
    )


def main(
    connect: Annotated[str, typer.Option(help="The vehicle's endpoint for its own sensors.")] = DEFAULT_CONNECT,
    vehicle: Annotated[str, typer.Option(help="The vehicle's name.")] = DEFAULT_VEHICLE,
    rate_hz: Annotated[float, typer.Option(min=1.0, max=400.0, help="Estimates a second.")] = 100.0,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="For how long; absent: until Ctrl-C.")] = None,
) -> None:
    """Publish odometry until Ctrl-C."""
    row, rng, begun = KEYS["odometry"], np.random.default_rng(1), time.monotonic()
    try:
        key = key_expression("odometry", vehicle)
        session = zenoh.open(client_config(connect))
    except (LinkError, ValueError) as error:
        sys.exit(f"vio_odometry.py: {error}")
    except zenoh.ZError:
        sys.exit(f"vio_odometry.py: nothing answers at {connect}: start goshawk-air there first")
    with session:
        publisher = session.declare_publisher(
            key,
            encoding=row.encoding,
            congestion_control=row.congestion,
            priority=row.priority,
            express=row.express,
        )
        seq = 0
        while seconds is None or time.monotonic() - begun < seconds:
            seq += 1
            publisher.put(estimate(seq, rng).SerializeToString())
            time.sleep(max(0.0, begun + seq / rate_hz - time.monotonic()))
    print(f"{seq} estimates sent")


if __name__ == "__main__":
    typer.run(main)
