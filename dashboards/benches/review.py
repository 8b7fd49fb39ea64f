"""How fast a flight opens in the review, how fast it seeks, and how much memory that takes.

python dashboards/benches/review.py                 ten minutes, some 1 GB
python dashboards/benches/review.py --minutes 90    some 10 GB, and as much of the disk

The log is made up, at the vehicle's own rates and sizes (control 200 Hz, plans and pictures 30 Hz), in a temporary
folder. Wall times of this machine as it is now; processor time beside them, since others may be using it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from goshawk_dashboards.gate import Access, Gate, Role
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.review.dashboard import Recording, ReviewView

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import recordings

SEEKS = 200
OPEN_LIMIT_S = 3.0
SEEK_LIMIT_S = 0.1
PORT = 18799


def memory_mb() -> float:
    """The most that this process ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def review(path: Path, duration_s: float) -> None:
    """Opens the log, seeks at random, prints. In a process that did not write it, for its memory."""
    begun_mb = memory_mb()
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    # The server stands for a browser: what is sent to nobody costs as much to make.
    gate = Gate(host="127.0.0.1", port=PORT, access=Access())
    server = open_server(gate, Role.OPERATOR, "bench")
    view = ReviewView(server, Recording.of([Flight.open(path)], None, None, None), threading.Event())
    view.show()
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    print(f"open to the first picture   {wall_s:6.2f} s  ({cpu_s:.2f} s of processor)   limit {OPEN_LIMIT_S:.0f} s")
    seeks_s: list[float] = []
    cpu_s = time.process_time()
    for time_s in np.random.default_rng(1).uniform(0.0, duration_s, SEEKS):
        view.player.seek(float(time_s))
        begun_s = time.perf_counter()
        view.show()
        seeks_s.append(time.perf_counter() - begun_s)
    cpu_s = (time.process_time() - cpu_s) / SEEKS
    p50, p99 = 1e3 * np.percentile(seeks_s, (50, 99))
    print(
        f"seek                  p50 {p50:6.1f} ms, p99 {p99:.1f} ms  ({1e3 * cpu_s:.1f} ms of processor)   "
        f"limit {1e3 * SEEK_LIMIT_S:.0f} ms"
    )
    print(f"memory                   {memory_mb():7.0f} MB at most, {begun_mb:.0f} MB before it was opened")
    close_server(server)
    gate.close()


def main() -> None:
    """Writes the log, and reviews it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="length of the flight [default: 10]")
    duration_s = 60.0 * parser.parse_args().minutes
    with tempfile.TemporaryDirectory() as folder:
        path = recordings.write_flight(Path(folder) / "flight.mcap", duration_s)
        print(f"{duration_s / 60.0:.0f} minutes of flight, {path.stat().st_size / 1e6:.0f} MB")
        reviewing = multiprocessing.get_context("spawn").Process(target=review, args=(path, duration_s))
        reviewing.start()
        reviewing.join()
    sys.exit(reviewing.exitcode)


if __name__ == "__main__":
    main()
