"""Browsers for the dashboard's benchmark, without their drawing: each takes all that viser sends and reads none of it.

python viewers.py LINK COUNT           prints `watching` once all are connected
"""

from __future__ import annotations

import sys
import threading

import msgspec
from goshawk_dashboards.gate.client import CAMERA, open_page


def watch(link: str, connected: threading.Barrier) -> None:
    """One browser, until the server ends."""
    with open_page(link) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        socket.recv()
        connected.wait(timeout=60.0)
        for _ in socket:
            pass


def main() -> None:
    """Watches until the server ends."""
    link, count = sys.argv[1], int(sys.argv[2])
    connected = threading.Barrier(count + 1)
    threads = [threading.Thread(target=watch, args=(link, connected)) for _ in range(count)]
    for thread in threads:
        thread.start()
    connected.wait(timeout=60.0)
    print("watching", flush=True)
    for thread in threads:
        thread.join()


if __name__ == "__main__":
    main()
