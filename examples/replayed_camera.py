"""A camera that replays a flight: publishes the images of a log on `in/rgbd`, at the rate that they were taken.

    python examples/replayed_camera.py logs/flight.mcap --connect tcp/127.0.0.1:7447

The stamps are new, so a vehicle on the bench takes the images for its own. Its motors know nothing of them.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
import zenoh
from goshawk_dashboards.log.flight import Flight, LogError
from goshawk_dashboards.log.frame import FrameView
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, LinkError, client_config
from goshawk_proto import KEYS, goshawk_pb2, key_expression


def rgbd(frame: FrameView, seq: int) -> goshawk_pb2.Rgbd | None:
    """The logged frame as a camera would send it now; None if its colour or depth cannot be read."""
    rgb_HW3, depth_m_HW = frame.rgb_HW3(), frame.depth_m_HW()
    if rgb_HW3 is None or depth_m_HW is None:
        return None
    depth_mm = np.rint(1000.0 * depth_m_HW).astype("<u2")
    return goshawk_pb2.Rgbd(
        seq=seq, stamp_ns=time.monotonic_ns(), width=frame.width, height=frame.height, hfov_rad=frame.hfov_rad,
        vfov_rad=frame.vfov_rad, rgb=rgb_HW3.tobytes(), depth_mm=depth_mm.tobytes(),
    )  # fmt: skip


def main(
    log: Annotated[Path, typer.Argument(help="A flight log.")],
    connect: Annotated[str, typer.Option(help="The vehicle's endpoint for its own sensors.")] = DEFAULT_CONNECT,
    vehicle: Annotated[str, typer.Option(help="The vehicle's name.")] = DEFAULT_VEHICLE,
) -> None:
    """Publish a log's images once, from the first to the last."""
    row = KEYS["rgbd"]
    try:
        flight = Flight.open(log)
        key = key_expression("rgbd", vehicle)
        session = zenoh.open(client_config(connect))
    except (LogError, LinkError, ValueError) as error:
        sys.exit(f"replayed_camera.py: {error}")
    except zenoh.ZError:
        sys.exit(f"replayed_camera.py: nothing answers at {connect}: start goshawk-air there first")
    times_s = flight.times_s("rgbd")
    begun, sent = time.monotonic(), 0
    with session:
        publisher = session.declare_publisher(
            key,
            encoding=row.encoding,
            congestion_control=row.congestion,
            priority=row.priority,
            express=row.express,
        )
        for time_s in times_s:
            time.sleep(max(0.0, begun + time_s - times_s[0] - time.monotonic()))
            frame = flight.frame_at(time_s)
            message = None if frame is None else rgbd(frame, sent + 1)
            if message is not None:
                publisher.put(message.SerializeToString())
                sent += 1
    print(f"{sent} of {len(times_s)} images sent")


if __name__ == "__main__":
    typer.run(main)
