"""What the ground station costs: ten vehicles at 30 Hz over real Zenoh, their dashboard served, memory over time.

    python dashboard.py [--seconds 120] [--browsers 1]
    python dashboard.py --frames [--seconds 120]

The vehicles are one other process, the ground station is `goshawk ground` itself in a third, so its figure is its own:
share of one core, and the slope of its memory after it has warmed up. The browsers are a fourth process, which takes
what is sent and draws nothing. The keys: `dashboard_core_fraction_10_vehicles`, `dashboard_memory_mb_per_min`; with
another number of browsers than one they end in `_N_browsers`. With `--frames` a real browser draws one vehicle's flight
instead: `frames.py`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import frames
import numpy as np
from common import core_seconds_of_threads, free_port, memory_mb, record, verdict, waited_seconds

VEHICLES = 10
TARGET_CORE = 1.0
TARGET_MB_PER_MIN = 0.1
"""6 MB in an hour."""
WARM_UP_S = 240.0
"""Until its windows are full: in the first two minutes it grows by 0.3 MB/min."""
MOST_WAITED = 0.5
"""Seconds a second that the ground station's threads may have waited for a core: beyond it, it was not doing its work,
and what it used says nothing."""


def main() -> None:
    """Measures and records."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=120.0, help="how long to measure")
    parser.add_argument("--warm-up", type=float, default=WARM_UP_S, help="seconds before it")
    parser.add_argument("--browsers", type=int, default=1, help="how many watch")
    parser.add_argument("--frames", action="store_true", help="count what a browser draws, and measure nothing else")
    args = parser.parse_args()
    if args.frames:
        frames.measure(args.seconds)
        return
    endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(VEHICLES)]
    script = Path(__file__).with_name("vehicles.py")
    fleet = subprocess.Popen([sys.executable, str(script), *endpoints], stdout=subprocess.PIPE, text=True)
    ground = viewers = None
    port = str(free_port())
    try:
        if fleet.stdout is None or fleet.stdout.readline() != "listening\n":
            raise SystemExit("the vehicles did not start")
        named = [word for k, e in enumerate(endpoints) for word in ("--vehicle", f"v{k}@{e}")]
        command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", "ground"]
        ground = subprocess.Popen([*command, "--port", port, *named], stdout=subprocess.PIPE, text=True)
        first = "" if ground.stdout is None else ground.stdout.readline()
        if not first.startswith("dashboard:"):
            raise SystemExit("the ground station did not start")
        if args.browsers:
            watchers = [str(Path(__file__).with_name("viewers.py")), first.split()[1], str(args.browsers)]
            viewers = subprocess.Popen([sys.executable, *watchers], stdout=subprocess.PIPE, text=True)
            if viewers.stdout is None or viewers.stdout.readline() != "watching\n":
                raise SystemExit("the browsers did not connect")
        time.sleep(args.warm_up)
        report(ground.pid, args.seconds, args.browsers)
    finally:
        for process in filter(None, (viewers, ground, fleet)):
            process.terminate()
            process.wait(timeout=20)


def report(pid: int, seconds: float, browsers: int) -> None:
    """Watches the ground station for a while, then prints and records."""
    began_s, before, waited_before = time.monotonic(), core_seconds_of_threads(pid), waited_seconds(pid)
    times_s: list[float] = []
    used_mb: list[float] = []
    while (late_s := time.monotonic() - began_s) < seconds:
        times_s.append(late_s)
        used_mb.append(memory_mb(pid))
        time.sleep(1.0)
    after = core_seconds_of_threads(pid)
    waited = (waited_seconds(pid) - waited_before) / (time.monotonic() - began_s)
    share = (sum(after.values()) - sum(before.values())) / (time.monotonic() - began_s)
    slope = float(np.polyfit(np.array(times_s) / 60.0, np.array(used_mb), 1)[0])
    print(f"ground station, {VEHICLES} vehicles at 30 Hz over Zenoh, {browsers} browsers, {seconds:.0f} s")
    print(f"  share of one core   {100 * share:8.1f} %         target 100 %: {verdict(share <= TARGET_CORE)}")
    parts = sorted(((after[n] - before.get(n, 0.0), n) for n in after), reverse=True)[:4]
    print("  of which            " + ", ".join(f"{n} {100 * s / (time.monotonic() - began_s):.1f} %" for s, n in parts))
    print(
        f"  memory              {used_mb[-1]:8.1f} MB, {slope:+.3f} MB/min   "
        f"target {TARGET_MB_PER_MIN:g}: {verdict(slope <= TARGET_MB_PER_MIN)}"
    )
    if waited > MOST_WAITED:
        raise SystemExit(
            f"not recorded: this machine is too busy, its threads waited {waited:.1f} s a second for a core"
        )
    suffix = "" if browsers == 1 else f"_{browsers}_browsers"
    record(f"dashboard_core_fraction_10_vehicles{suffix}", round(share, 3))
    record(f"dashboard_memory_mb_per_min{suffix}", round(slope, 3))


if __name__ == "__main__":
    main()
