"""The flight table: campaigns listed in a TOML file, flown one after the other, kept as JSON and written as Markdown.

A row that was flown with the same options and policy is not flown again, so that a table of hours can be stopped and
gone on with. What else decides a flight, the simulator and the vehicle file, it does not compare: delete a row's JSON
after they changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import signal
import subprocess
import tempfile
import tomllib
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from goshawk_train.errors import TrainerError
from goshawk_train.model.card import FLIGHT_MARKS

# Why a flight failed. A result from before a reason was counted has none of it.
FAILURES = ("collision", "lost", "timeout", "too_close")


class FlightsError(TrainerError):
    """The table cannot be flown; the message says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One campaign."""

    name: str
    task: str
    speeds: list[float]
    spacings: list[float] = field(default_factory=list[float])
    options: list[str] = field(default_factory=list[str])
    scan: list[str] = field(default_factory=list[str])
    """Options of `goshawk-sim world` whose world is scanned first, for the flights to take place in the point cloud."""
    target: float | None = None
    """The least share of successes that ACCEPTANCE.md wants."""

    def arguments(self, trials: int, seed: int) -> list[str]:
        """What `goshawk-sim` is called with."""
        out = ["fly", "--task", self.task, "--speed", ",".join(f"{v:g}" for v in self.speeds)]
        out += ["--trials", str(trials), "--seed", str(seed)]
        if self.spacings:
            out += ["--spacing", ",".join(f"{s:g}" for s in self.spacings)]
        return out + self.options

    def file(self, folder: Path) -> Path:
        """Where its report is kept."""
        return folder / (re.sub(r"[^a-z0-9.]+", "-", self.name.lower()) + ".json")


def load(path: Path) -> tuple[int, int, list[Row]]:
    """Trials a cell, seed and rows; raises `FlightsError`."""
    try:
        table = tomllib.loads(path.read_text())
        return int(table["trials"]), int(table["seed"]), [Row(**row) for row in table["row"]]
    except (OSError, tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise FlightsError(f"{path} is no flight table: {error}") from error


def fly(row: Row, folder: Path, simulator: Path, models: Path, *, trials: int, seed: int) -> dict[str, Any]:
    """The row's report; flown unless it is there already."""
    policy = models / f"{row.task}.onnx"
    arguments = row.arguments(trials, seed)
    if "classical" not in arguments or row.task == "track":
        arguments += ["--policy", str(policy)]
    identity: dict[str, Any] = {
        "arguments": arguments,
        "policy_sha256": hashlib.sha256(policy.read_bytes()).hexdigest(),
        **({"scan": row.scan} if row.scan else {}),
    }
    kept = row.file(folder)
    if kept.exists() and (report := json.loads(kept.read_text())).get("flown") == identity:
        return report
    partial = kept.with_suffix(".partial")
    with tempfile.TemporaryDirectory() as scratch:
        world: list[str] = []
        if row.scan:
            cloud = Path(scratch) / "scan.ply"
            _run(row, simulator, ["world", *row.scan, "--scan", str(cloud), "--output", str(cloud.with_suffix(".png"))])
            world = ["--world", str(cloud)]
        _run(row, simulator, [*arguments, *world, "--json", str(partial)])
    report = {"flown": identity, **json.loads(partial.read_text())}
    # Where each flight went is megabytes; the command is in `flown`, without the scan's passing place.
    for name in ("paths", "command"):
        del report[name]
    kept.write_text(json.dumps(report, indent=1) + "\n")
    partial.unlink()
    return report


def _run(row: Row, simulator: Path, arguments: list[str]) -> None:
    child: subprocess.Popen[bytes] | None = None
    try:
        with _signals_held():
            child = subprocess.Popen([str(simulator), *arguments])
        status = child.wait()
    except OSError as error:
        raise FlightsError(f"cannot run {simulator}: {error.strerror}; build it with `make build`") from error
    finally:
        if child is not None and child.poll() is None:
            child.kill()
            child.wait()
    if status:
        raise FlightsError(f"{row.name}: goshawk-sim ended with {status}; its message is above")


@contextlib.contextmanager
def _signals_held() -> Generator[None]:
    """A signal comes afterwards: in the middle of a start it would end us and leave the child flying."""
    came: list[int] = []
    held = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number in held:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in held.items():
            signal.signal(number, handler)
    for number in came[:1]:
        signal.raise_signal(number)


def markdown(rows: list[tuple[Row, dict[str, Any]]]) -> str:
    """The table of all cells."""
    lines = [
        "| flight | speed, m/s | spacing, m | successes | 95 % | target | collision, lost, timeout, too close "
        "| clearance p5, m | flown mean, m/s | in view | lateral, along error 5..95 %, m |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row, report in rows:
        lines += [_line(row, cell) for cell in report["cells"]]
    return "\n".join(lines)


def _line(row: Row, cell: dict[str, Any]) -> str:
    def spread(of: dict[str, float]) -> str:
        return f"{of['p5']:.2f} .. {of['p95']:.2f}"

    share, failures, error = cell["successes"] / cell["trials"], cell["failures"], cell["target_error_m"]
    verdict = "" if row.target is None else f"{row.target:.0%} {'met' if share >= row.target else 'missed'}"
    low, high = cell["success_interval"]
    view = "" if cell["in_view_fraction"] is None else f"{cell['in_view_fraction']:.0%}"
    errors = "" if error is None else f"{spread(error['lateral'])}; {spread(error['longitudinal'])}"
    spacing = f"{cell['spacing_m']:g}" if cell["world"] == "forest" else ""
    cells = [
        *(row.name, f"{cell['speed_mps']:g}", spacing, f"{cell['successes']} of {cell['trials']}"),
        *(f"{low:.0%} to {high:.0%}", verdict, ", ".join(str(failures.get(why, 0)) for why in FAILURES)),
        *(f"{cell['clearance_m']['p5']:.2f}", f"{cell['flown_speed_mps']['mean']:.1f}", view, errors),
    ]
    return "| " + " | ".join(cells) + " |"


def put_on_card(models: Path, task: str, rows: list[tuple[Row, dict[str, Any]]]) -> None:
    """Writes what the task's policy flew into its model card, between the marks that `export` put there."""
    own = [(row, report) for row, report in rows if row.task == task and "classical" not in row.options]
    card = models / f"{task}.md"
    if own and card.exists() and FLIGHT_MARKS[0] in card.read_text():
        put(card, markdown(own))


def put(path: Path, table: str, marks: tuple[str, str] = FLIGHT_MARKS) -> None:
    """Replace what stands between the marks of a Markdown file; raises `FlightsError` if it has none."""
    begin, end = marks
    text = path.read_text() if path.exists() else f"{begin}\n{end}\n"
    if text.count(begin) != 1 or text.count(end) != 1:
        raise FlightsError(f"{path} lacks the marks {begin} and {end}")
    before, rest = text.split(begin)
    path.write_text(f"{before}{begin}\n{table}\n{end}{rest.split(end)[1]}")
