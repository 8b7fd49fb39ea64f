"""From the files that a reviewer names to a running review."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from goshawk_dashboards.gate import Access, Gate, Tls
from goshawk_dashboards.log.flight import Flight, LogError
from goshawk_dashboards.log.recorded import Replay
from goshawk_dashboards.review.dashboard import ReviewDashboard

__all__ = ["LogError", "open_review"]


def open_review(
    logs: Sequence[Path],
    replay: Path | None,
    *,
    host: str,
    port: int,
    access: Access | None = None,
    tls: Tls | None = None,
) -> ReviewDashboard:
    """A running review of one flight or of two, and of a replay: named as such, or the second log if it is one.

    Raises LogError (one line) for a file that is no log or does not belong here, PortBusyError (an OSError) if the
    port is taken, UnguardedError (an OSError) for a host that other machines reach, without ``tls``.
    """
    if len(logs) > 2:
        raise LogError(f"{len(logs)} logs are too many: review one flight, or two to compare them")
    flight = Flight.open(logs[0])
    if not flight.count("control"):
        raise LogError(f"{logs[0]} holds no flight: nothing of the controller is in it; name a flight's log first")
    second = Flight.open(logs[1]) if len(logs) == 2 else None
    if second is not None and not second.count("control"):
        if replay is not None:
            raise LogError(f"{logs[1]} is a replay as {replay} is: name one of them")
        second, replay = None, logs[1]
    answers = None if replay is None else _replay_of(flight, replay)
    gate = Gate(host=host, port=port, access=access or Access(), tls=tls)
    dashboard = ReviewDashboard(gate=gate, flight=flight, replay=answers, second=second)
    dashboard.start()
    return dashboard


def _replay_of(flight: Flight, path: Path) -> Replay:
    replay = Replay(Flight.open(path, start_ns=flight.start_ns))
    if not replay.answers(flight):
        raise LogError(f"{path} is no replay of {flight.path}: its plans are not of that flight's frames")
    return replay
