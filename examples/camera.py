"""A camera of your own: publishes colour and depth on `in/rgbd`, as a driver does.

    python examples/camera.py --connect tcp/127.0.0.1:7447

Replace `picture` by what your camera delivers. Run it on the vehicle's own computer: pictures from elsewhere are
refused, and the stamp is of that computer's monotonic clock.
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

WIDTH, HEIGHT = 160, 96
HFOV_RAD, VFOV_RAD = np.radians(90.0), np.radians(61.93)
"""Of the image that is sent. It must be the policy's, within 2 %: crop the image if your lens sees more."""


def picture(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Colour (HEIGHT x WIDTH x 3 bytes) and depth (HEIGHT x WIDTH, mm along the optical axis; 0: not measured).

    Here: a wall of stripes that leans away to the right, with a sensor's noise.
    """
    column_W = np.arange(WIDTH)
    stripes_HW = np.tile(60.0 + 120.0 * (column_W // 8 % 2), (HEIGHT, 1))
    colour_HW3 = np.repeat(stripes_HW[..., None], 3, axis=2) + rng.normal(0.0, 4.0, (HEIGHT, WIDTH, 3))
    depth_HW = np.tile(3000.0 + 15.0 * column_W, (HEIGHT, 1)) + rng.normal(0.0, 20.0, (HEIGHT, WIDTH))
    return colour_HW3.clip(0, 255).astype(np.uint8), depth_HW.astype("<u2")


def main(
    connect: Annotated[str, typer.Option(help="The vehicle's endpoint for its own sensors.")] = DEFAULT_CONNECT,
    vehicle: Annotated[str, typer.Option(help="The vehicle's name.")] = DEFAULT_VEHICLE,
    rate_hz: Annotated[float, typer.Option(min=1.0, max=120.0, help="Pictures a second.")] = 30.0,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="For how long; absent: until Ctrl-C.")] = None,
) -> None:
    """Publish pictures until Ctrl-C."""
    row, rng, begun = KEYS["rgbd"], np.random.default_rng(1), time.monotonic()
    try:
        key = key_expression("rgbd", vehicle)
        session = zenoh.open(client_config(connect))
    except (LinkError, ValueError) as error:
        sys.exit(f"camera.py: {error}")
    except zenoh.ZError:
        sys.exit(f"camera.py: nothing answers at {connect}: start goshawk-air there first")
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
            stamp_ns = time.monotonic_ns()  # the middle of the exposure
            rgb, depth = picture(rng)
            frame = goshawk_pb2.Rgbd(
                seq=seq, stamp_ns=stamp_ns, width=WIDTH, height=HEIGHT, hfov_rad=HFOV_RAD, vfov_rad=VFOV_RAD,
                rgb=rgb.tobytes(), depth_mm=depth.tobytes(),
            )  # fmt: skip
            publisher.put(frame.SerializeToString())
            time.sleep(max(0.0, begun + seq / rate_hz - time.monotonic()))
    print(f"{seq} pictures sent")


if __name__ == "__main__":
    typer.run(main)
