"""What each part beyond the paper is worth: the paper's method, with each part alone, all, and all but each.

`configs/extensions.toml` lists the parts and the campaigns. All fly the same seeds, so that lines compare. A line that
was flown with the same switches, policy, vehicle file and flight code is not flown again; one of others stays in the
table and says so. A part of one task alone leaves the other's flights as they are: those are its base's.
"""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from goshawk_train.campaigns.flights import (
    FlightsError,
    Row,
    fly,
    present,
    read_report,
    read_rows,
    refuse_unknown,
    whole,
    write_whole,
)
from goshawk_train.rates import RateDifference

Cells = dict[str, dict[str, Any]]
"""What came of a line, by the campaigns' names."""
TASKS = ["track", "navigate"]
CHANGES = {
    "policies": "policy",
    "vehicle_sha256": "vehicle file",
    "flight_code_sha256": "flight code",
    "switches": "switches",
    "campaigns": "campaigns",
}
"""What decides a line's flights, as its JSON calls it, and as people do."""


@dataclass(frozen=True, kw_only=True)
class Base:
    """What a part is added to, or taken from."""

    name: str
    vehicle: Path
    track: str
    """Policies, by their files' names."""
    navigate: str
    on: bool
    """All parts are; off: none."""

    def policy(self, task: str) -> str:
        """The task's."""
        return self.track if task == "track" else self.navigate


@dataclass(frozen=True, kw_only=True)
class Part:
    """Something beyond the paper."""

    name: str
    switches: list[str]
    needs: list[str] = field(default_factory=list[str])
    """Switches that it does nothing without: where it is switched on, they are too."""
    tasks: list[str] = field(default_factory=lambda: TASKS)
    """Whose flights it changes."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One line of the table."""

    base: Base
    part: str | None
    """What differs from the base; None: nothing."""
    switches: dict[str, bool]
    tasks: list[str]
    """What it changes."""

    @property
    def name(self) -> str:
        """As the table calls it."""
        if self.part is None:
            return self.base.name
        return f"{self.base.name}, {'without' if self.base.on else 'with'} {self.part}"

    @property
    def slug(self) -> str:
        """The name, for files."""
        return re.sub(r"[^a-z0-9]+", "-", self.name.lower()).strip("-")

    def write(self, folder: Path) -> Path:
        """The vehicle file, and its tuning file beside it, in a folder of their own."""
        text = self.base.vehicle.read_text()
        named = re.search(r'^tuning = "([^"]+)"', text, re.MULTILINE)
        if named is None:
            raise FlightsError(f"{self.base.vehicle} names no tuning file")
        tuning = (self.base.vehicle.parent / named[1]).read_text()
        bare = re.sub(r"^\[extensions\]\n(?:(?!\[).*\n)*", "", tuning, flags=re.MULTILINE)
        lines = [f"{name} = {'true' if on else 'false'}" for name, on in self.switches.items()]
        out = folder / self.slug
        out.mkdir(parents=True, exist_ok=True)
        (out / "tuning.toml").write_text("\n".join([bare, "[extensions]", *lines, ""]))
        (out / "vehicle.toml").write_text(text.replace(named[0], 'tuning = "tuning.toml"'))
        return out / "vehicle.toml"


@dataclass(frozen=True, kw_only=True)
class Line:
    """A variant that was flown."""

    cells: Cells
    stale: str = ""
    """What is another now than when it was flown; empty: nothing."""
    identity: dict[str, Any] = field(default_factory=dict[str, Any])
    """What it was flown with."""

    def compares(self, base: Line) -> bool:
        """What it was flown with is the base's but for the switches, and in campaigns that the base flew as well."""
        same = set(CHANGES) - {"switches", "campaigns"}
        own, other = ([line.identity.get(name) for name in same] for line in (self, base))
        flown = base.identity.get("campaigns", [])
        return own == other and all(campaign in flown for campaign in self.identity.get("campaigns", []))


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is flown."""

    table: str
    """The plan's file's name: so its table is called, and the folder of its JSON."""
    trials: int
    seed: int
    campaigns: list[Row]
    variants: list[Variant]

    @property
    def marks(self) -> tuple[str, str]:
        """Between which the table stands."""
        return f"<!-- {self.table}: begin -->", f"<!-- {self.table}: end -->"

    def only(self, slugs: list[str]) -> Plan:
        """With the named lines alone; raises `FlightsError` for one that there is not."""
        known = {variant.slug: variant for variant in self.variants}
        if unknown := [slug for slug in slugs if slug not in known]:
            raise FlightsError(f"no line is named {', '.join(unknown)}; there are {', '.join(known)}")
        return replace(self, variants=[known[slug] for slug in slugs]) if slugs else self


def load(path: Path) -> Plan:
    """The plan in a TOML file; raises `FlightsError`."""
    try:
        table = tomllib.loads(path.read_text())
        refuse_unknown(table, {"trials", "seed", "base", "part", "campaign"})
        bases = [
            Base(
                name=base["name"],
                vehicle=Path(base["vehicle"]),
                track=base["track"],
                navigate=base["navigate"],
                on=base["on"],
            )
            for base in table["base"]
        ]
        parts = [Part(**part) for part in table["part"]]
        campaigns = read_rows(table["campaign"])
        if several := [row.name for row in campaigns if row.cells != 1]:
            raise ValueError(f"{', '.join(several)} must be of one cell: one speed, spacing, pilot and course")
        if wrong := [part.name for part in parts if not set(part.tasks) <= set(TASKS)]:
            raise ValueError(f"tasks of {', '.join(wrong)} must be some of {TASKS}")
        variants = [variant for base in bases for variant in _variants(base, parts)]
        if len({variant.slug for variant in variants}) < len(variants):
            raise ValueError("it has two lines of one name: results are kept by it")
        return Plan(
            table=path.stem,
            trials=whole(table, "trials"),
            seed=whole(table, "seed", 0),
            campaigns=campaigns,
            variants=variants,
        )
    except (OSError, tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise FlightsError(f"{path} lists no extensions: {error}") from error


def _variants(base: Base, parts: list[Part]) -> list[Variant]:
    switches = dict.fromkeys((name for part in parts for name in part.switches), base.on)
    changed = [
        Variant(
            base=base,
            part=part.name,
            switches=switches | dict.fromkeys(part.switches if base.on else [*part.switches, *part.needs], not base.on),
            tasks=part.tasks,
        )
        for part in parts
    ]
    return [Variant(base=base, part=None, switches=switches, tasks=TASKS), *changed]


def identity(plan: Plan, variant: Variant, simulator: Path, models: Path) -> dict[str, Any]:
    """What a line's flights depend on; raises `FlightsError`."""
    policies = {task: models / variant.base.policy(task) for task in ("track", "navigate")}
    hashes = {task: present(simulator, path, str(variant.base.vehicle)) for task, path in policies.items()}
    return {
        "switches": variant.switches,
        "policies": {task: found["policy_sha256"] for task, found in hashes.items()},
        **{name: hashes["track"][name] for name in ("vehicle_sha256", "flight_code_sha256")},
        "campaigns": [row.arguments(plan.trials, plan.seed) + row.scan for row in _flown(plan, variant)],
    }


def _flown(plan: Plan, variant: Variant) -> list[Row]:
    return [row for row in plan.campaigns if row.task in variant.tasks]


def kept(plan: Plan, variant: Variant, folder: Path, simulator: Path, models: Path) -> Line | None:
    """The line as it was flown last, and whether that still holds; None: never, or in more campaigns or fewer."""
    path = folder / f"{variant.slug}.json"
    if not path.exists():
        return None
    known, now = read_report(path, "identity", "cells"), identity(plan, variant, simulator, models)
    flown = known["identity"]
    if len(flown["campaigns"]) != len(now["campaigns"]):
        return None
    changed = [word for name, word in CHANGES.items() if flown.get(name) != now.get(name)]
    names: list[str] = [row.name for row in _flown(plan, variant)]
    if sorted(flown["campaigns"]) == sorted(now["campaigns"]):  # the plan may list them in another order now
        names = [names[now["campaigns"].index(campaign)] for campaign in flown["campaigns"]]
    cells = dict(zip(names, known["cells"], strict=True))
    return Line(cells=cells, stale=", ".join(changed), identity=flown)


def carry_out(plan: Plan, variant: Variant, folder: Path, runs: Path, simulator: Path, models: Path) -> None:
    """Flies each campaign that the line changes, unless `folder` has it; keeps the full reports in `runs`."""
    known = kept(plan, variant, folder, simulator, models)
    if known is not None and not known.stale:
        return
    now, vehicle = identity(plan, variant, simulator, models), variant.write(runs)
    cells: list[dict[str, Any]] = []
    for campaign in _flown(plan, variant):
        model = variant.base.policy(campaign.task)
        row = replace(campaign, model=model, options=[*campaign.options, "--vehicle-file", str(vehicle)])
        also = {name: now[name] for name in ("switches", "vehicle_sha256", "flight_code_sha256")}
        report = fly(
            row, vehicle.parent, simulator, models, trials=plan.trials, seed=plan.seed, seeds="tuning", also=also
        )
        (cell,) = report["cells"]
        brief = {name: value for name, value in cell.items() if name not in ("flights", "target_plane")}
        cells.append({**brief, "outcomes": [flight["outcome"] for flight in cell["flights"]]})
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / f"{variant.slug}.json", json.dumps({"identity": now, "cells": cells}, indent=1) + "\n")


def markdown(plan: Plan, known: dict[str, Line]) -> str:
    """The table of all lines that are known, by their slugs: successes in each campaign with their 95 % interval, their
    sum, flights that reached their end by the lax rule, collisions, and how many more successes there are than the
    base's in the same flights. Where more than the switches differs from the base, lines do not compare."""
    if not known:
        return "None is flown yet."
    names = [campaign.name for campaign in plan.campaigns]
    head = ["what flies", *names, "all", "reached", "collisions", "against its base"]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for variant in plan.variants:
        if (line := known.get(variant.slug)) is None:
            continue
        own, base = line.cells, known.get(replace(variant, part=None).slug)
        compares = base is not None and line.compares(base)
        told = [_share(own[name]) if name in own else "the same" if compares else "" for name in names]
        sums, against = ["", "", ""], ""
        if base is not None and compares:
            whole = (base.cells | own).values()
            trials, won, reached = (sum(cell[key] for cell in whole) for key in ("trials", "successes", "reached"))
            collisions = sum(cell["failures"]["collision"] for cell in whole)
            sums = [f"{won} of {trials}", str(reached), str(collisions)]
            against = _against(base.cells, own) if variant.part else ""
        name = f"{variant.name} (stale: another {line.stale})" if line.stale else variant.name
        lines.append(f"| {' | '.join([name, *told, *sums, against])} |")
    return "\n".join(lines)


def _against(base: Cells, own: Cells) -> str:
    """By McNemar's exact test: what differs may be luck above p 0.05."""
    pairs = [
        (a == "success", b == "success")
        for name, cell in own.items()
        for a, b in zip(base[name]["outcomes"], cell["outcomes"], strict=True)
    ]
    only_a, only_b, both = (pairs.count(pair) for pair in ((True, False), (False, True), (True, True)))
    difference = RateDifference(what="a success", flights=len(pairs), only_a=only_a, only_b=only_b, both=both)
    return f"{only_b - only_a:+d} ({only_b} won, {only_a} lost; p {difference.p:.2g})"


def _share(cell: dict[str, Any]) -> str:
    low, high = cell["success_interval"]
    return f"{cell['successes']} of {cell['trials']} ({low:.0%} to {high:.0%})"
