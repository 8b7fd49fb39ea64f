"""The flight table: campaigns listed in a TOML file, flown one after the other, kept as JSON and written as Markdown.

A row that was flown with the same options, policy, vehicle file and flight code is not flown again, so that a table of
hours can be stopped and gone on with. Where one of them has changed since, the row is stale, and says so.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import signal
import subprocess
import tempfile
import tomllib
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

from goshawk_train.errors import TrainerError
from goshawk_train.model.card import FLIGHT_MARKS

VEHICLE = "air/vehicles/sim.toml"
"""What `goshawk-sim` flies unless a row names another."""
HASHES = {
    "policy_sha256": "policy",
    "vehicle_sha256": "vehicle file",
    "flight_code_sha256": "flight code",
}
"""What decides a row's flights besides its options, as `goshawk-sim seeds` calls it, and as people do."""


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
    model: str | None = None
    """The policy's file; None: the task's."""
    target: float | None = None
    """The least share of successes that is wanted of the policy."""
    cruise: float | None = None
    """The least cruise speed that is wanted of it, as a share of the asked one."""

    def arguments(self, trials: int, seed: int | None) -> list[str]:
        """What `goshawk-sim` is called with, without what the seed is for. No seed: it comes of the hashes."""
        out = ["fly", "--task", self.task, "--speed", ",".join(f"{v:g}" for v in self.speeds)]
        out += ["--trials", str(trials)]
        if seed is not None:
            out += ["--seed", str(seed)]
        if self.spacings:
            out += ["--spacing", ",".join(f"{s:g}" for s in self.spacings)]
        return out + self.options

    def with_policy(self, arguments: list[str], models: Path) -> list[str]:
        """The classical pilot alone navigates without."""
        alone = "classical" in self.options and self.task == "navigate"
        return arguments if alone else [*arguments, "--policy", str(self.policy(models))]

    @property
    def vehicle(self) -> str:
        """The vehicle file."""
        named = [value for option, value in pairwise(self.options) if option == "--vehicle-file"]
        return named[0] if named else VEHICLE

    @property
    def of_card(self) -> bool:
        """It flies the task's own policy on the default vehicle, as the policy's card says."""
        return self.model in (None, f"{self.task}.onnx") and self.vehicle == VEHICLE

    def policy(self, models: Path) -> Path:
        """The named one, or the task's."""
        return models / (self.model or f"{self.task}.onnx")

    def file(self, folder: Path) -> Path:
        """Where its report is kept."""
        return folder / (re.sub(r"[^a-z0-9.]+", "-", self.name.lower()) + ".json")

    @property
    def cells(self) -> int:
        """How many the simulator makes of it: all combinations of what is listed."""
        given = dict(pairwise(self.options))
        listed = [given.get(option, "one").split(",") for option in ("--pilot", "--course")]
        forest = not self.scan and given.get("--world", "forest") == "forest"
        spacings = max(len(self.spacings), len(given.get("--spacing", "one").split(","))) if forest else 1
        return len(self.speeds) * spacings * len(set(listed[0])) * len(listed[1])


NUMBERS: Any = (int, float)
LISTS: dict[str, Any] = {"speeds": NUMBERS, "spacings": NUMBERS, "options": str, "scan": str}
SHARE: Any = (int, float, type(None))
SINGLE: dict[str, Any] = {"name": str, "task": str, "model": (str, type(None)), "target": SHARE, "cruise": SHARE}


def read_rows(tables: Any) -> list[Row]:
    """The rows that a TOML file lists; raises `TypeError` or `ValueError`, which say what is wrong with one."""
    if not isinstance(tables, list):
        raise TypeError("each row begins with its name in double brackets, as [[row]]")
    rows = [Row(**table) for table in cast("list[Any]", tables)]
    for row in rows:
        told = vars(row)
        for name, wanted in LISTS.items():
            listed: Any = told[name]
            if not isinstance(listed, list) or not all(isinstance(one, wanted) for one in cast("list[Any]", listed)):
                raise TypeError(f"{name} of {row.name} must be a list of {'words' if wanted is str else 'numbers'}")
        for name, wanted in SINGLE.items():
            if not isinstance(told[name], wanted):
                raise TypeError(f"{name} of {row.name} must not be {told[name]!r}")
        if not row.speeds or any(len(set(some)) < len(some) for some in (row.speeds, row.spacings)):
            raise ValueError(f"{row.name} needs speeds, and each speed and spacing once")
        if glued := [option for option in row.options if re.match("--[a-z-]+=", option)]:
            raise ValueError(f"{row.name} has {glued[0]}: write the option and its value as two words")
    if len({row.file(Path()) for row in rows}) < len(rows):
        raise ValueError("it has two rows of one name: results are kept by it")
    return rows


def whole(table: dict[str, Any], name: str, least: int = 1) -> int:
    """A whole number of a TOML file; raises `ValueError`."""
    value = table.get(name)
    if type(value) is not int or value < least:
        raise ValueError(f"{name} must be a whole number of {least} or more")
    return value


def refuse_unknown(table: dict[str, Any], known: set[str]) -> None:
    """Raises `ValueError` for a key that nobody reads."""
    if unknown := sorted(set(table) - known):
        raise ValueError(f"it has no key {', '.join(unknown)}")


@dataclass(frozen=True, kw_only=True)
class Kept:
    """A row of the table, and what is known of it."""

    row: Row
    report: dict[str, Any] | None
    """None: it was never flown."""
    stale: str = ""
    """What is another now than when it was flown; empty: nothing."""

    @property
    def fresh(self) -> bool:
        """It need not be flown."""
        return self.report is not None and not self.stale


def load(path: Path) -> tuple[int, list[Row]]:
    """Trials a cell, and rows; raises `FlightsError`."""
    try:
        table = tomllib.loads(path.read_text())
        if "seed" in table:
            raise ValueError("its seed comes of policy, vehicle file and flight code: leave out seed")
        refuse_unknown(table, {"trials", "row"})
        return whole(table, "trials"), read_rows(table["row"])
    except (OSError, tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise FlightsError(f"{path} is no flight table: {error}") from error


@cache
def present(simulator: Path, policy: Path, vehicle: str = VEHICLE) -> Mapping[str, Any]:
    """The hashes of today, and `table_seed`, which comes of them."""
    with tempfile.TemporaryDirectory() as scratch:
        found = Path(scratch) / "seeds.json"
        files = ["--policy", str(policy), "--vehicle-file", vehicle, "--json", str(found)]
        _run("the hashes", simulator, ["seeds", *files], quiet=True)
        return json.loads(found.read_text())


def kept(row: Row, folder: Path, simulator: Path, models: Path, *, trials: int) -> Kept:
    """The row as it was flown last, and whether that still holds."""
    path = row.file(folder)
    if not path.exists():
        return Kept(row=row, report=None)
    report = read_report(path, "cells")
    now, flown = _identity(row, simulator, models, trials), report.get("flown", {})
    changed = [word for name, word in HASHES.items() if flown.get(name) != now[name]]
    if any(flown.get(name) != now.get(name) for name in ("arguments", "scan")):
        changed.append("options")
    if "rule" not in report:
        changed.append("rule")
    return Kept(row=row, report=report, stale=", ".join(changed))


def read_report(path: Path, *needed: str) -> dict[str, Any]:
    """What was kept of flights, with these keys at least; raises `FlightsError`."""
    try:
        report = json.loads(path.read_text())
        for name in needed:
            report[name]
    except (KeyError, TypeError, ValueError) as error:
        raise FlightsError(f"{path} is damaged: remove it, and run the same again ({error})") from error
    return report


def write_whole(path: Path, text: str) -> None:
    """A file that is the old one or the new one, whatever ends this."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_text(text)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _identity(row: Row, simulator: Path, models: Path, trials: int) -> dict[str, Any]:
    now = present(simulator, row.policy(models), row.vehicle)
    arguments = row.with_policy(row.arguments(trials, None), models)
    scan = {"scan": row.scan} if row.scan else {}
    return {"arguments": arguments, **{name: now[name] for name in HASHES}, **scan}


def fly_row(row: Row, folder: Path, simulator: Path, models: Path, *, trials: int) -> Kept:
    """Flies a row of the table, with the seed that comes of its hashes."""
    identity = _identity(row, simulator, models, trials)
    table_seed = present(simulator, row.policy(models), row.vehicle)["table_seed"]
    return Kept(row=row, report=_fly(row, folder, simulator, identity, table_seed, seeds="table"))


def fly(
    row: Row,
    folder: Path,
    simulator: Path,
    models: Path,
    *,
    trials: int,
    seed: int,
    seeds: str = "table",
    also: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The report of a campaign with a seed of a range, the tables' or tuning; flown unless it is there already. `also`
    is what decides its flights beside options and policy."""
    identity: dict[str, Any] = {
        "arguments": row.with_policy(row.arguments(trials, seed), models),
        "policy_sha256": hashlib.sha256(row.policy(models).read_bytes()).hexdigest(),
        **({"scan": row.scan} if row.scan else {}),
        **(also or {}),
    }
    path = row.file(folder)
    if path.exists() and (report := read_report(path, "cells")).get("flown") == identity:
        return report
    return _fly(row, folder, simulator, identity, seed, seeds=seeds)


def _fly(row: Row, folder: Path, simulator: Path, identity: dict[str, Any], seed: int, *, seeds: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as scratch:
        world: list[str] = []
        if row.scan:
            cloud = Path(scratch) / "scan.ply"
            made = ["--seed", str(seed), "--scan", str(cloud), "--output", str(cloud.with_suffix(".png"))]
            _run(row.name, simulator, ["world", *row.scan, *made])
            world = ["--world", str(cloud)]
        flown = Path(scratch) / "flown.json"
        _run(row.name, simulator, [*identity["arguments"], *world, "--seeds", seeds, "--json", str(flown)])
        report = {"flown": identity, **json.loads(flown.read_text())}
    # Where each flight went is megabytes; the command is in `flown`, without the scan's passing place.
    for name in ("paths", "command"):
        del report[name]
    write_whole(row.file(folder), json.dumps(report, indent=1) + "\n")
    return report


def _run(what: str, simulator: Path, arguments: list[str], *, quiet: bool = False) -> None:
    child: subprocess.Popen[bytes] | None = None
    try:
        with _signals_held():
            output = subprocess.DEVNULL if quiet else None
            child = subprocess.Popen([str(simulator), *arguments], stdout=output)
        status = child.wait()
    except OSError as error:
        raise FlightsError(f"cannot run {simulator}: {error.strerror}; build it with `make build`") from error
    finally:
        if child is not None and child.poll() is None:
            child.kill()
            child.wait()
    if status:
        raise FlightsError(f"{what}: goshawk-sim ended with {status}; its message is above")


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


COLUMNS = (
    *(
        "flight",
        "pilot",
        "asked, m/s",
        "cruise, m/s",
        "peak, m/s",
        "spacing, m",
        "success",
        "95 %",
        "target",
        "reached",
    ),
    *("failures", "clearance p5, m", "in view", "lateral, along error 5..95 %, m"),
)


def markdown(table: list[Kept], pilots: tuple[str, ...] = ("policy", "classical")) -> str:
    """The table of all cells of these pilots, and what a success is."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    rules: dict[str, str] = {}
    for kept in table:
        if kept.report is None:
            blank = ["not flown yet", f"{', '.join(f'{v:g}' for v in kept.row.speeds)}"]
            lines.append("| " + " | ".join([kept.row.name, *blank, *[""] * (len(COLUMNS) - 3)]) + " |")
            continue
        lines += [_line(kept, cell) for cell in kept.report["cells"] if cell["pilot"] in pilots]
        if rule := kept.report.get("rule"):
            rules[kept.row.task] = rule
    lines += [f"\n{task}, {line}" for task, rule in rules.items() for line in rule.splitlines()]
    return "\n".join(lines)


def _line(kept: Kept, cell: dict[str, Any]) -> str:
    def spread(of: dict[str, float]) -> str:
        return f"{of['p5']:.2f} .. {of['p95']:.2f}"

    def number(value: float | None, digits: int) -> str:
        return "–" if value is None else f"{value:.{digits}f}"

    error, trials, strict = cell["target_error_m"], cell["trials"], "reached" in cell
    # Before the strict rule, successes were what is reached now.
    success = f"{cell['successes']} of {trials}" if strict else "–"
    low, high = cell["success_interval"]
    cells = [
        f"{kept.row.name} (stale: another {kept.stale})" if kept.stale else kept.row.name,
        *(cell["pilot"], f"{cell['speed_mps']:g}"),
        *(number(cell.get("cruise_speed_mps"), 1), number(cell.get("peak_speed_mps"), 1)),
        *(f"{cell['spacing_m']:g}" if cell["world"] == "forest" else "", success),
        *(f"{low:.0%} to {high:.0%}" if strict else "–", "" if kept.stale else _verdict(kept.row, cell)),
        f"{cell.get('reached', cell['successes'])} of {trials}",
        *(failures([cell]), number(cell["clearance_m"]["p5"], 2)),
        "" if cell["in_view_fraction"] is None else f"{cell['in_view_fraction']:.0%}",
        "" if error is None else f"{spread(error['lateral'])}; {spread(error['longitudinal'])}",
    ]
    return "| " + " | ".join(cells) + " |"


def _verdict(row: Row, cell: dict[str, Any]) -> str:
    """What is wanted of the policy, and whether it is met."""
    if cell["pilot"] != "policy":
        return ""

    def wanted() -> Iterator[str]:
        if row.target is not None:
            yield f"{row.target:.0%} {_met(cell['successes'] / cell['trials'] >= row.target)}"
        if row.cruise is not None:
            least_mps = row.cruise * cell["speed_mps"]
            yield f"{least_mps:g} m/s {_met((cell['cruise_speed_mps'] or 0) >= least_mps)}"

    return ", ".join(wanted())


def _met(met: bool) -> str:
    return "met" if met else "missed"


def failures(cells: list[dict[str, Any]]) -> str:
    """Why flights failed, and how many did: "collision 2, out of view 1"."""
    reasons = dict.fromkeys(reason for cell in cells for reason in cell["failures"])
    counts = {reason: sum(cell["failures"].get(reason, 0) for cell in cells) for reason in reasons}
    return ", ".join(f"{reason.replace('_', ' ')} {count}" for reason, count in counts.items() if count) or "none"


def put_on_card(models: Path, task: str, table: list[Kept]) -> None:
    """Writes what the task's policy flew into its model card, between the marks that `export` put there. Rows of other
    policies and vehicles are left out."""
    own = [kept for kept in table if kept.row.task == task and kept.row.of_card and kept.fresh]
    card = models / f"{task}.md"
    if own and card.exists() and FLIGHT_MARKS[0] in card.read_text():
        put(card, markdown(own, ("policy",)))


def put(path: Path, table: str, marks: tuple[str, str] = FLIGHT_MARKS) -> None:
    """Replace what stands between the marks of a Markdown file; raises `FlightsError` if it has none."""
    begin, end = marks
    text = path.read_text() if path.exists() else f"{begin}\n{end}\n"
    if text.count(begin) != 1 or text.count(end) != 1:
        raise FlightsError(f"{path} lacks the marks {begin} and {end}")
    before, rest = text.split(begin)
    write_whole(path, f"{before}{begin}\n{table}\n{end}{rest.split(end)[1]}")
