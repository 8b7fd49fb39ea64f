"""One flight log as one row of the table; None: the log does not tell."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from goshawk_dashboards.charts.clearance import seen_clearance
from goshawk_dashboards.charts.errors import target_errors
from goshawk_dashboards.log.flight import Flight, ForeignLogError, LogError
from goshawk_dashboards.log.progress import Progress, unheard
from goshawk_dashboards.report.latency import latencies
from goshawk_dashboards.report.summary import GOOD_OUTCOMES, card, figures, on_task

UNREADABLE = "unreadable"
POLICY_DIGITS = 8
"""Of a policy's SHA-256."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A flight. A field's name is its column's; its type becomes the column's."""

    path: str
    began: str | None = None
    """When, RFC 3339 and UTC; a simulated flight has no date."""
    vehicle: str | None = None
    profile: str | None = None
    task: str | None = None
    policy: str | None = None
    """The first digits of its SHA-256."""
    version: str | None = None
    duration_s: float | None = None
    outcome: str = UNREADABLE
    good: bool = False
    """It ended as it should, and nothing went wrong."""
    faults: tuple[str, ...] = ()
    fault_count: int | None = None
    clearance_m: float | None = None
    """The least on its task: from the hull by the simulator; without one from the vehicle's middle by depth."""
    clearance_by: str | None = None
    """"truth" or "depth"."""
    collisions: int | None = None
    path_m: float | None = None
    speed_mps: float | None = None
    top_speed_mps: float | None = None
    disturbance_mps2: float | None = None
    top_disturbance_mps2: float | None = None
    in_sight: float | None = None
    """Of the time on a tracking task, 0 to 1."""
    size_bytes: int = 0
    damage: str | None = None
    """What is wrong with the log: cut off, which seconds it lacks, or why it cannot be read."""


def row_of(path: Path, progress: Progress = unheard) -> Row | None:
    """Reads a whole log. None: it is another program's. One that cannot be read is a row that says why."""
    try:
        return _row(Flight.open(path, progress=progress), progress)
    except ForeignLogError:
        return None
    except LogError as error:
        damage = str(error).removeprefix(f"{path} ")
    except Exception as error:  # whatever is odd about one log, the others are listed
        damage = f"makes no sense: {' '.join(str(error).split()) or type(error).__name__}"
    return Row(path=str(path), size_bytes=path.stat().st_size if path.is_file() else 0, damage=damage)


def writable(text: str) -> str:
    """What is no UTF-8, in a file's name or in a log, as an escape."""
    return text.encode(errors="backslashreplace").decode()


def _row(flight: Flight, progress: Progress) -> Row:
    facts, numbers = card(flight), figures(flight, None, target_errors(flight), latencies(flight))
    clearance_m, by = numbers.true_clearance_m, "truth"
    if clearance_m is None:
        seen = seen_clearance(flight, progress)
        clearance_m, by = None if seen is None else seen.within(on_task(flight, seen.times_s_M)).least_m, "depth"
    return Row(
        path=str(flight.path),
        began=_date(facts.wall_time),
        vehicle=facts.vehicle or None,
        profile=facts.profile or None,
        task=facts.task,
        policy=(facts.policy_sha256 or "")[:POLICY_DIGITS] or None,
        version=facts.version or None,
        duration_s=facts.duration_s,
        outcome=facts.outcome,
        good=facts.outcome in GOOD_OUTCOMES and not facts.faults,
        faults=facts.faults,
        fault_count=len(facts.faults),
        clearance_m=clearance_m,
        clearance_by=None if clearance_m is None else by,
        collisions=numbers.collisions,
        path_m=numbers.path_m,
        speed_mps=numbers.mean_speed_mps,
        top_speed_mps=numbers.max_speed_mps,
        disturbance_mps2=numbers.mean_disturbance_mps2,
        top_disturbance_mps2=numbers.max_disturbance_mps2,
        in_sight=numbers.in_sight_fraction,
        size_bytes=facts.size_bytes,
        damage=None if flight.completeness == "complete" else flight.completeness,
    )


def _date(wall_time: str | None) -> str | None:
    """As the table takes it; None: it is no date."""
    try:
        return datetime.fromisoformat(wall_time or "").isoformat()
    except ValueError:
        return None
