"""A peer that floods a vehicle until it is killed: `python flood.py KIND ENDPOINT IDENTITY`. Prints how often, Hz."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import zenoh
from goshawk_ground.link import DEFAULT_VEHICLE
from goshawk_proto import goshawk_pb2, key_expression
from test_strangers import stranger_config

PAYLOAD = bytes(100_000_000)
KEYS_ASKED = ("cmd_stop", "cmd_start", "ping", "missed")


def flood(kind: str, session: zenoh.Session) -> Callable[[int], None]:
    """One message, the n-th."""
    stop = goshawk_pb2.StopRequest(command_id="flood").SerializeToString()

    def ask(n: int) -> None:
        key = key_expression(KEYS_ASKED[n % len(KEYS_ASKED)], DEFAULT_VEHICLE)
        session.get(key, lambda _: None, payload=stop, timeout=0.2, priority=zenoh.Priority.REAL_TIME, express=True)

    def ping(_: int) -> None:
        session.get(key_expression("ping", DEFAULT_VEHICLE), lambda _: None, timeout=0.2)

    def shout(n: int) -> None:
        name = ("rgbd", "health")[n % 2]
        session.put(
            key_expression(name, DEFAULT_VEHICLE),
            PAYLOAD,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.REAL_TIME,
        )

    def declare(n: int) -> None:
        session.declare_subscriber(f"goshawk/{DEFAULT_VEHICLE}/{n}/**", lambda _: None).undeclare()

    return {"queries": ask, "pings": ping, "payloads": shout, "declarations": declare}[kind]


def main() -> None:
    """Sends as fast as it can."""
    kind, endpoint, identity = sys.argv[1:]
    with zenoh.open(stranger_config(endpoint, Path(identity))) as session:
        send = flood(kind, session)
        sent, since = 0, time.monotonic()
        while True:
            send(sent)
            sent += 1
            now = time.monotonic()
            if now - since > 1.0:
                print(f"{sent / (now - since):.0f} Hz", flush=True)
                sent, since = 0, now


if __name__ == "__main__":
    main()
