"""A log may be far larger than memory: what reading takes does not grow with it as the file does."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.log import mcap_file
from goshawk_dashboards.log.flight import Flight
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb

READ = """
import resource, sys
from pathlib import Path
from goshawk_dashboards.exports.source import records
from goshawk_dashboards.log import mcap_file
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.season.row import row_of
mcap_file.SMALL_KEPT_BYTES = 1 << 20
path = Path(sys.argv[1])
assert row_of(path).outcome == "ended: landing"
assert sum(1 for _ in records(Flight.open(path))) > 900
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""
"""Lists the flight, then hands over each record as an export does; prints the most memory it had, bytes."""


def long_flight(path: Path, seconds: int) -> Path:
    """A flight with images of 80 kB, 30 a second, which no compression makes smaller."""
    log, noise = rec.LogFile(path), np.random.default_rng(1)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite"))
    for step in range(seconds * rec.CONTROL_HZ):
        time_s = step / rec.CONTROL_HZ
        stamp_ns = rec.START_NS + round(time_s * 1e9)
        log.write("control", stamp_ns, rec.control(time_s, step, seconds))
        if step % 10 == 0:
            log.write("sim_truth", stamp_ns, rec.truth(time_s))
        if step % 7 == 0:
            log.write("rgbd", stamp_ns, pb.CompressedRgbd(seq=step, stamp_ns=stamp_ns, rgb_png=noise.bytes(80_000)))
    log.close()
    return path


def most_bytes(path: Path) -> int:
    done = subprocess.run([sys.executable, "-c", READ, path], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_memory_grows_by_less_than_a_fifth_of_what_the_log_grows(tmp_path: Path) -> None:
    short, long = long_flight(tmp_path / "short.mcap", 4), long_flight(tmp_path / "long.mcap", 32)
    longer_by = long.stat().st_size - short.stat().st_size
    assert longer_by > 60_000_000
    assert most_bytes(long) - most_bytes(short) < 0.2 * longer_by


def test_a_record_that_memory_no_longer_holds_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = rec.write_flight(tmp_path / "flight.mcap", 4.0, chunk_bytes=100_000)
    whole = Flight.open(path)
    monkeypatch.setattr(mcap_file, "SMALL_KEPT_BYTES", 1)
    poor = Flight.open(path)
    for topic in whole.log.topics:
        for index in range(len(whole.log.times_ns(topic))):
            assert poor.log.payload(topic, index) == whole.log.payload(topic, index)
