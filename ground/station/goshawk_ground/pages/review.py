"""From the files that a reviewer names to a running review."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from goshawk_dashboards.charts.beside import Beside
from goshawk_dashboards.gate import Access, Gate, Tls
from goshawk_dashboards.log.beside.files import BesideError
from goshawk_dashboards.log.flight import Flight, LogError
from goshawk_dashboards.log.progress import Progress, unheard
from goshawk_dashboards.log.recorded import Replay
from goshawk_dashboards.review.altering import Replanner
from goshawk_dashboards.review.dashboard import ReviewDashboard

__all__ = ["BesideError", "LogError", "open_review"]

MOST_LOGS = 6
"""As many as have a colour of their own."""


def open_review(
    logs: Sequence[Path],
    replay: Path | None,
    *,
    host: str,
    port: int,
    access: Access | None = None,
    tls: Tls | None = None,
    replanner: Replanner | None = None,
    beside: Path | None = None,
    progress: Progress = unheard,
) -> ReviewDashboard:
    """A running review of flights, the first with the others beside it, and of a replay: named as such, or the second
    log if it is one. ``replanner`` plans the first flight again where a viewer alters it.
    ``beside`` is the autopilot's own log of the first flight. ``progress`` hears of each flight's bytes by its name.

    Raises LogError or BesideError (one line) for a file that is no log or does not belong here, PortBusyError (an
    OSError) if the port is taken, UnguardedError (an OSError) for a host that other machines reach, without ``tls``.
    """
    if len(logs) > MOST_LOGS:
        raise LogError(f"{len(logs)} logs are too many: review {MOST_LOGS} at once at most")
    flights = [Flight.open(log, progress=_of(log, progress)) for log in logs]
    if replay is None and len(flights) == 2 and not flights[1].count("control"):
        replay = logs[1]
        del flights[1]
    for flight in flights:
        if not flight.count("control"):
            raise LogError(f"{flight.path} holds no flight: nothing of the controller is in it; name flights only")
    answers = None if replay is None else _replay_of(flights[0], replay, progress)
    other = None if beside is None else Beside.open(beside, flights[0])
    gate = Gate(host=host, port=port, access=access or Access(), tls=tls)
    dashboard = ReviewDashboard(gate=gate, flights=flights, replay=answers, replanner=replanner, beside=other)
    dashboard.start()
    return dashboard


def _of(log: Path, progress: Progress) -> Progress:
    """A bar of its own for each of several logs."""
    return lambda what, done, total: progress(f"{what} {log.name}", done, total)


def _replay_of(flight: Flight, path: Path, progress: Progress) -> Replay:
    replay = Replay(Flight.open(path, start_ns=flight.start_ns, progress=_of(path, progress)))
    if not replay.answers(flight):
        raise LogError(f"{path} is no replay of {flight.path}: its plans are not of that flight's frames")
    return replay
