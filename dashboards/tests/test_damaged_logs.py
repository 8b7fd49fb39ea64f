"""Whatever has become of a log's bytes: the readers answer, in bounded memory, or refuse the file in one line."""

from __future__ import annotations

import random
import struct
import tracemalloc
import zlib
from pathlib import Path

import pytest
import recordings as rec
import zstandard
from goshawk_dashboards.log.flight import CHANNELS, Flight, LogError
from goshawk_dashboards.log.mcap_file import CHUNK_LIMIT, MAGIC
from goshawk_dashboards.log.recover import recover
from goshawk_dashboards.report.report import make_report, write_page
from goshawk_dashboards.report.summary import card
from mcap.opcode import Opcode

RECORD = struct.Struct("<BQ")
CHUNK = struct.Struct("<QQQII")
TO_PACKED = RECORD.size + CHUNK.size + len("zstd")
"""From a chunk's begin to the length of what is packed."""
LENGTHS = (0, 1, 2**31 - 1, 2**32 - 1, 2**48, 2**63 - 1, 2**64 - 1)
MOST_BYTES = 2 * CHUNK_LIMIT
"""A chunk of the largest size that is believed, twice. The log itself is 1 MB."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A flight of a second and a half in some ten chunks."""
    path = rec.write_flight(tmp_path_factory.mktemp("log") / "flight.mcap", 1.5, chunk_bytes=150_000)
    return path.read_bytes()


def ask_for_everything(path: Path, folder: Path) -> None:
    """All that dashboards, tables and reports ask of a log, and a recovery of it."""
    flight = Flight.open(path)
    for name in CHANNELS:
        for index in range(flight.count(name)):
            flight.message(name, index)
    for at_s in (0.0, 0.5 * flight.duration_s, flight.duration_s):
        for view in (flight.plan_at, flight.control_at, flight.target_at, flight.truth_at, flight.health_at):
            view(at_s)
        frame = flight.frame_at(at_s)
        if frame is not None:
            frame.points_cam_P3()
    assert card(flight).outcome and flight.completeness
    assert flight.events is not None and flight.phases is not None and flight.fallbacks is not None
    recovered = folder / "recovered.mcap"
    recovered.unlink(missing_ok=True)
    recover(path, recovered)


def survives(data: bytes, folder: Path) -> bool:
    """It is read, or refused by name in one line, and takes no more memory than a log may. Was it read?"""
    path, read = folder / "damaged.mcap", True
    path.write_bytes(data)
    tracemalloc.start()
    try:
        ask_for_everything(path, folder)
    except LogError as error:
        read = False
        assert str(path) in str(error) and "\n" not in str(error), error
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < MOST_BYTES, f"{peak} bytes"
    return read


def records(data: bytes) -> list[int]:
    """Where each record of a file begins, up to its footer."""
    places, at = list[int](), len(MAGIC)
    while at + RECORD.size <= len(data) - len(MAGIC):
        places.append(at)
        at += RECORD.size + RECORD.unpack_from(data, at)[1]
    return places


def chunks(data: bytes) -> list[int]:
    found = [at for at in records(data) if data[at] == Opcode.CHUNK]
    assert len(found) > 5
    return found


def spoil(data: bytes, dice: random.Random, spots: int) -> bytes:
    """Some bytes of it are others."""
    spoiled = bytearray(data)
    for _ in range(spots):
        spoiled[dice.randrange(len(spoiled))] = dice.randrange(256)
    return bytes(spoiled)


def repacked(data: bytes, at: int, dice: random.Random, share: float) -> bytes:
    """The chunk at a place: some of its records' contents spoiled under a checksum that is right, or under none."""
    _, length = RECORD.unpack_from(data, at)
    begin_ns, end_ns, _, _, _ = CHUNK.unpack_from(data, at + RECORD.size)
    end = at + RECORD.size + length
    inside, place = bytearray(zstandard.decompress(data[at + TO_PACKED + 8 : end])), 0
    while place < len(inside):
        _, length = RECORD.unpack_from(inside, place)
        place += RECORD.size
        if dice.random() < share:
            # Mostly the begin: channel and time of a message, ids and the lengths of texts.
            size = min(length, dice.choice([22, 22, 200]))
            inside[place : place + size] = spoil(bytes(inside[place : place + size]), dice, dice.choice([1, 8]))
        place += length
    crc = zlib.crc32(inside) if dice.random() < 0.5 else 0
    packed = zstandard.compress(bytes(inside))
    content = CHUNK.pack(begin_ns, end_ns, len(inside), crc, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    return data[:at] + RECORD.pack(Opcode.CHUNK, len(content)) + content + data[end:]


def test_bytes_written_over_anywhere_and_a_cut_are_survived_and_mostly_read(whole: bytes, tmp_path: Path) -> None:
    read = list[bool]()
    for seed in range(20):
        dice = random.Random(seed)
        damaged = MAGIC + spoil(whole[len(MAGIC) :], dice, dice.choice([1, 5, 50]))
        read.append(survives(damaged, tmp_path))
        read.append(survives(damaged[: dice.randrange(len(MAGIC), len(damaged))], tmp_path))
    assert sum(read) > 0.6 * len(read), read


@pytest.mark.parametrize("length", LENGTHS)
def test_a_length_that_is_blown_up_is_read_around_wherever_it_stands(whole: bytes, tmp_path: Path, length: int) -> None:
    written = struct.pack("<Q", length)
    first, middle = chunks(whole)[0], chunks(whole)[5]
    summary = next(at for at in records(whole) if whole[at] == Opcode.DATA_END)
    # A record's own length, a chunk's size, its name's and its packed length; the footer's place of the summary.
    for at in [*(at + 1 for at in (len(MAGIC), first, middle, summary)), middle + 25, middle + 33, middle + TO_PACKED,
               len(whole) - len(MAGIC) - 20]:  # fmt: skip
        assert survives(whole[:at] + written + whole[at + 8 :], tmp_path), at


def test_records_spoiled_before_their_checksum_was_made_are_survived_and_mostly_read(
    whole: bytes, tmp_path: Path
) -> None:
    read = list[bool]()
    for seed in range(30):
        dice = random.Random(seed)
        at = dice.choice([chunks(whole)[0], dice.choice(chunks(whole))])
        read.append(survives(repacked(whole, at, dice, dice.choice([0.03, 0.3, 1.0])), tmp_path))
    assert sum(read) > 0.6 * len(read), read


def test_a_log_that_lost_the_controllers_steps_is_reported(tmp_path: Path) -> None:
    log = rec.LogFile(tmp_path / "lost.mcap")
    for step in range(60):
        log.write("plan", rec.START_NS + step * 33_000_000, rec.plan(step * 0.033, step))
        log.write("sim_truth", rec.START_NS + step * 33_000_000, rec.truth(step * 0.033))
    log.close()
    page = tmp_path / "report.html"
    write_page(make_report(Flight.open(tmp_path / "lost.mcap")), page)
    assert "</html>" in page.read_text()


def test_a_time_that_no_clock_tells_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "late.mcap"
    log = rec.LogFile(path)
    log.write("plan", 2**63, rec.plan(0.0, 0))
    log.close()
    with pytest.raises(LogError, match="no whole record"):
        Flight.open(path)
