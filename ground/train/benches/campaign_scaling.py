"""What a campaign costs, and how it grows with workers, against one `goshawk-sim fly` on one thread.

    python campaign_scaling.py [--trials 60]

Flies the same chases by one simulator and by several beside each other, by the local engine on 1, 2, … workers, and on
Ray. N workers are to fly 0.9 N times what one of the same engine does, on cores that nothing else uses. What N
simulators do that know nothing of each other is what the machine gives. The keys: `campaign_scaling` (flights per
second by engine and workers), `campaign_flights_per_core_hour`, `campaign_bytes_per_flight`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "ground/station/benches"))

from common import record, verdict  # noqa: E402
from goshawk_train.cluster import plan as plans  # noqa: E402
from goshawk_train.cluster import run as campaign  # noqa: E402
from goshawk_train.cluster.query import ask  # noqa: E402
from goshawk_train.cluster.store import Store  # noqa: E402

SIMULATOR, MODELS = ROOT / "target/release/goshawk-sim", ROOT / "air/models"
TARGET = 0.9
"""Of as many times one worker's flights as there are workers."""
PLAN = """
seed = 5
seeds = "tuning"

[[row]]
name = "Chase"
task = "track"
speeds = [4]
"""


def main() -> None:
    """Measures and records."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--trials",
        type=int,
        default=60,
        help="flights in each row of the bench; with few, Ray's start weighs more than in a campaign",
    )
    trials = parser.parse_args().trials
    os.chdir(ROOT)
    with tempfile.TemporaryDirectory() as scratch:
        measure(Path(scratch), trials)


def beside(command: list[str | Path], count: int) -> float:
    """How often a second a command is done of which so many run beside each other."""
    begun = time.monotonic()
    running = [subprocess.Popen(command, stdout=subprocess.DEVNULL) for _ in range(count)]
    if any(process.wait() for process in running):
        raise SystemExit(f"{command[0]} fly failed")
    return count / (time.monotonic() - begun)


def measure(folder: Path, trials: int) -> None:
    """All rows."""
    (folder / "plan.toml").write_text(f"trials = {trials}\n{PLAN}")
    plan = plans.load(folder / "plan.toml")
    one = ["fly", "--task", "track", "--speed", "4", "--seed", "5", "--trials", str(trials), "--threads", "1"]
    workers = sorted({1, 2, len(os.sched_getaffinity(0))})
    alone = {count: beside([SIMULATOR, *one, "--policy", MODELS / "track.onnx"], count) * trials for count in workers}
    yardstick = alone[1]
    print(f"{trials} chases{'flights/s':>32}{'of one thread':>16}")
    for count, rate in alone.items():
        print(f"  {f'goshawk-sim fly, {count} beside each other':34}{rate:7.2f}{rate / yardstick:15.2f}x")
    rates = {f"fly_{count}": round(rate, 3) for count, rate in alone.items()}
    store = Store(str(folder))
    with campaign.ready(plan, SIMULATOR, MODELS) as made:
        for engine, count in [(engine, count) for engine in ("local", "ray") for count in workers]:
            store = Store(str(folder / f"{engine}-{count}"))
            flying = campaign.engine(engine, made, count, None)
            begun = time.monotonic()
            campaign.fly(made, store, lambda flying=flying: flying)
            rate = trials / (time.monotonic() - begun)
            rates[f"{engine}_{count}"] = round(rate, 3)
            print(f"  {engine}, {count} workers{rate:24.2f}{rate / yardstick:15.2f}x", end="")
            grown = rate / rates[f"{engine}_1"]
            print(
                f", {grown:.2f} x one worker (≥ {TARGET * count:g}: {verdict(grown >= TARGET * count)};"
                f" the machine gives {alone[count] / yardstick:.2f})"
                if count > 1
                else ""
            )
        campaign.gather(made, store)
    record("campaign_scaling", rates)
    ((flights, core_s),) = ask(store, "select count(*), sum(core_s) from flights").fetchall()
    kept = Path(store.address)
    units = sum(path.stat().st_size for path in (kept / "units").iterdir())
    lean = (kept / "flights.parquet").stat().st_size
    per_hour, each = flights / core_s * 3600, (units + lean) / flights
    print(f"  flights per core-hour {per_hour:8.0f}\n  storage, kB a flight {each / 1e3:8.1f}")
    print(f"  100,000 flights: {1e5 / per_hour:.0f} core-hours, {1e5 * each / 1e9:.1f} GB")
    record("campaign_flights_per_core_hour", round(per_hour))
    record("campaign_bytes_per_flight", round(each))


if __name__ == "__main__":
    main()
