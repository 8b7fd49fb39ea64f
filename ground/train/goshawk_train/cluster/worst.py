"""The worst flights of a campaign, flown again with their logs. Each is the same flight, which is checked."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from goshawk_train.cluster import table
from goshawk_train.cluster.query import ask
from goshawk_train.cluster.run import Ready
from goshawk_train.cluster.store import Store, StoreError
from goshawk_train.cluster.worker import PROGRAM, last_words

WORST = """
select row, cell, trial, outcome, contact, clearance_m, unit from flights
order by outcome = 'success', outcome <> 'collision', clearance_m nulls last, row, cell, trial limit {count}
"""


@dataclass(frozen=True, kw_only=True)
class Flown:
    """A flight and its log."""

    row: str
    cell: int
    trial: int
    ending: str
    clearance_m: float | None
    log: str


def fly(made: Ready, store: Store, count: int) -> Iterator[Flown]:
    """Collisions first, then what else failed, then what came nearest to something; raises `StoreError` if a flight is
    not the same again."""
    rows = {campaign.row.name: campaign for campaign in made.campaigns}
    with tempfile.TemporaryDirectory(prefix="goshawk-worst-") as scratch:
        folder = Path(scratch)
        kit = made.kit.unpack(folder / "kit")
        for row, cell, trial, outcome, contact, clearance_m, unit in ask(store, WORST.format(count=count)).fetchall():
            kept = table.read_unit(store, unit, ["trial", "record"]).to_pylist()
            (known,) = [flight["record"] for flight in kept if flight["trial"] == trial]
            own = rows[row].row.file(Path()).stem
            name, out = f"logs/{own}-{cell}-{trial}.mcap", folder / f"{own}-{cell}-{trial}"
            records = out.with_suffix(".records")
            command = [kit / PROGRAM, *rows[row].one(cell, trial), "--log", out, "--records", records]
            done = subprocess.run(command, cwd=kit, capture_output=True, text=True, check=False)
            if done.returncode:
                raise StoreError(f"{row} {cell}:{trial}: {last_words(done.stderr, done.returncode)}")
            if records.read_text().strip() != known:
                raise StoreError(
                    f"{row} {cell}:{trial} is another flight on this machine: its processor computes otherwise; "
                    "fly the worst where the campaign was flown"
                )
            (log,) = out.glob("*.mcap")
            store.write(name, log.read_bytes())
            ending = f"{outcome} ({contact})" if contact else outcome
            yield Flown(row=row, cell=cell, trial=trial, ending=ending, clearance_m=clearance_m, log=store.url(name))
