"""Browsers for the dashboard's benchmark, without their drawing: each takes all that viser sends and reads none of it.

python viewers.py ADDRESS COUNT        prints `watching` once all are connected
"""

from __future__ import annotations

import sys
import threading

import msgspec
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (3.0, 3.0, 3.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 900,
    "image_width": 1440,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""What a browser says first; viser counts it as connected from then on."""


def watch(address: str, connected: threading.Barrier) -> None:
    """One browser, until the server ends."""
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    with connect(address, subprotocols=[protocol], max_size=None, compression=None) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        socket.recv()
        connected.wait(timeout=60.0)
        for _ in socket:
            pass


def main() -> None:
    """Watches until the server ends."""
    address, count = sys.argv[1], int(sys.argv[2])
    connected = threading.Barrier(count + 1)
    threads = [threading.Thread(target=watch, args=(address, connected)) for _ in range(count)]
    for thread in threads:
        thread.start()
    connected.wait(timeout=60.0)
    print("watching", flush=True)
    for thread in threads:
        thread.join()


if __name__ == "__main__":
    main()
