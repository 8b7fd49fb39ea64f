"""A vehicle in flight, passed on to other people's tools: each has a thread of its own, which waits for nobody."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Protocol, Self

from goshawk_dashboards.exports.source import Record
from goshawk_dashboards.page.viewer import Guard
from goshawk_proto import KEYS

from goshawk_ground.link import GroundLink
from goshawk_ground.link.tap import stamp_ns

WAIT_S = 0.2
MOST_PORT = 65535


class Tool(Protocol):
    """What takes a vehicle's messages."""

    def take(self, record: Record) -> None:
        """Passes one on."""
        ...

    def close(self) -> None:
        """Ends it."""
        ...


class Feed:
    """One vehicle's messages on their way to one tool, for as long as its ``with`` lasts."""

    def __init__(self, link: GroundLink, tool: Tool) -> None:
        self._link, self._tool = link, tool
        self._closing = threading.Event()
        self._guard = Guard()
        self._thread = threading.Thread(target=self._run, name="tool", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        with self._link.tap() as tap:
            over = False
            while not over:
                over = self._closing.is_set()  # then what waits goes on its way still
                for channel, message in tap.take(0.0 if over else WAIT_S):
                    at_ns = stamp_ns(channel, message)
                    topic = KEYS[channel].suffix
                    with self._guard.over(self._tool):
                        self._tool.take(Record(channel=channel, topic=topic, log_ns=at_ns, message=message))
        self._tool.close()


def foxglove_feeds(links: Sequence[GroundLink], port: int) -> dict[str, Feed]:
    """A feed for each vehicle by the address of its server: the first at ``port``, the others at those above it.

    Raises OSError, one line, if one is taken.
    """
    from goshawk_dashboards.exports.foxglove_live import FoxgloveServer  # 50 MB: only where it is used

    if (last := port + len(links) - 1) > MOST_PORT:
        raise OSError(f"the {len(links)} vehicles would need ports up to {last} for Foxglove: give a lower --foxglove")
    servers: list[FoxgloveServer] = []
    try:
        for k, link in enumerate(links):
            servers.append(FoxgloveServer(f"Goshawk: {link.vehicle}", port + k))
    except OSError:
        for server in servers:
            server.close()
        raise
    return {server.url: Feed(link, server) for server, link in zip(servers, links, strict=True)}


def rerun_feeds(links: Sequence[GroundLink], address: str) -> list[Feed]:
    """A feed for each vehicle to one Rerun viewer, a recording each. Raises OSError, one line."""
    try:
        from goshawk_dashboards.exports.rerun_live import RerunViewer  # an extra
    except ModuleNotFoundError as error:
        raise OSError("--rerun needs the package rerun-sdk, which is not installed: make setup-rerun") from error
    return [Feed(link, RerunViewer(link.vehicle, address)) for link in links]
