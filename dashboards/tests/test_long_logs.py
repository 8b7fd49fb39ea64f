"""A log may be far larger than memory: what reading takes does not grow with it as the file does."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.log import small
from goshawk_dashboards.log.flight import Flight, LogError, header_of
from goshawk_dashboards.log.mcap_file import BEGINNING, first_message
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from mcap.writer import Writer

READ = """
import resource, sys
from pathlib import Path
from goshawk_dashboards.exports.source import records
from goshawk_dashboards.log import small
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.season.row import row_of
small.HELD_BYTES = 1 << 20
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
    monkeypatch.setattr(small, "HELD_BYTES", 1)
    poor = Flight.open(path)
    for topic in whole.log.topics:
        for index in range(len(whole.log.times_ns(topic))):
            assert poor.log.payload(topic, index) == whole.log.payload(topic, index)


def test_two_threads_read_one_log_that_was_walked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(small, "HELD_BYTES", 1)
    flight = Flight.open(rec.write_flight(tmp_path / "flight.mcap", 4.0, chunk_bytes=100_000))
    wanted = flight.columns("control", ["pos_world"])["pos_world"]
    with ThreadPoolExecutor(4) as pool:
        read = [pool.submit(flight.again().columns, "control", ["pos_world"]) for _ in range(8)]
        for one in read:
            np.testing.assert_array_equal(one.result()["pos_world"], wanted)


def test_no_room_for_what_memory_does_not_hold_is_one_line(tmp_path: Path) -> None:
    path = rec.write_flight(tmp_path / "flight.mcap", 4.0)
    script = (
        "import resource, sys; from pathlib import Path; from goshawk_dashboards.log import small, flight\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)); small.HELD_BYTES = 1\n"
        "try: flight.Flight.open(Path(sys.argv[1]))\n"
        "except flight.LogError as error: print(error)"
    )
    tried = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script, path], capture_output=True, text=True, timeout=60, env=tried)
    assert done.stdout == f"cannot read {path}: {tmp_path} has no room for it: File too large\n", done.stderr


def test_who_waits_for_a_log_hears_how_far_it_is(tmp_path: Path) -> None:
    heard: list[tuple[int, int]] = []

    def hear(what: str, done: int, total: int) -> None:
        assert what == "reading"
        heard.append((done, total))

    Flight.open(rec.write_flight(tmp_path / "flight.mcap", 4.0, chunk_bytes=100_000), progress=hear)
    assert len(heard) > 5 and heard == sorted(heard)
    assert heard[-1][0] == heard[-1][1] == heard[0][1]


def test_the_flight_before_is_known_by_its_first_record(tmp_path: Path) -> None:
    path = rec.write_flight(tmp_path / "1.mcap", 4.0, chunk_bytes=100_000)
    whole = Flight.open(path).header
    path.write_bytes(path.read_bytes()[:150_000] + b"damaged")
    assert header_of(path) == whole
    path.write_bytes(b"no log")
    assert header_of(path) is None


def test_a_long_file_of_another_program_is_not_read_to_its_end_for_a_header(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=10_000)
        writer.start()
        channel = writer.register_channel("/other", "json", 0)
        for k in range(2 * BEGINNING):
            writer.add_message(channel, k, b"{}" * 50, k)
        place = file.tell()
        writer.finish()
    # What would be met there is no record.
    path.write_bytes(path.read_bytes()[: place - 20_000] + b"x" * 100_000)
    with pytest.raises(LogError, match="does not begin with log/header"):
        first_message(path, "log/header")


def test_whatever_stands_beside_a_log_its_header_is_read_or_is_none(tmp_path: Path) -> None:
    path, rng = rec.write_flight(tmp_path / "1.mcap", 1.0, chunk_bytes=20_000), np.random.default_rng(1)
    begun, whole = bytearray(path.read_bytes()[:30_000]), Flight.open(path).header
    found = list[bool]()
    for _ in range(200):
        changed = begun.copy()
        for at in rng.integers(0, 300, rng.integers(1, 9)):
            changed[at] = rng.choice([0, 127, 255])
        path.write_bytes(changed)
        header = header_of(path)
        found.append(header == whole)
    assert not all(found)
