"""Reading a flight log back: every record, any instant, whole or cut off."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.log.flight import CHANNELS, Flight, ForeignLogError, LogError, header_of
from goshawk_dashboards.log.mcap_file import McapLog
from goshawk_dashboards.log.phases import phases_of
from goshawk_dashboards.log.recorded import marks_of
from goshawk_dashboards.log.recover import recover
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

DURATION_S = 8.0


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up flight in chunks of half a second or so."""
    return rec.write_flight(tmp_path_factory.mktemp("log") / "flight.mcap", DURATION_S, chunk_bytes=200_000)


@pytest.fixture
def flight(path: Path) -> Flight:
    """It, opened."""
    return Flight.open(path)


def test_every_record_of_a_closed_log_is_there(flight: Flight) -> None:
    assert flight.closed
    assert flight.count("control") == DURATION_S * rec.CONTROL_HZ
    assert abs(flight.count("plan") - DURATION_S * rec.FRAME_HZ) <= 1
    assert flight.count("rgbd") == flight.count("plan")
    assert flight.count("odometry") == 0
    assert flight.header.vehicle == "kite"
    assert flight.duration_s == pytest.approx(DURATION_S - 1 / rec.CONTROL_HZ)
    assert [e.text for e in flight.events] == ["start accepted"]


def test_columns_are_the_messages(flight: Flight) -> None:
    columns = flight.columns("control", ["seq", "pos_world", "world_from_body", "plan_age_s", "mode"])
    assert np.array_equal(columns["seq"], np.arange(len(columns)))
    assert columns["pos_world"].shape == (len(columns), 3)
    assert np.allclose(columns["pos_world"][:, 0], 4.0 * columns.times_s)
    assert np.array_equal(columns["world_from_body"][0], [1, 0, 0, 0])
    assert np.isnan(columns["plan_age_s"]).all()
    assert columns["mode"][0] == pb.MODE_TAKEOFF


def test_thinned_columns_keep_the_rate_asked_for(flight: Flight) -> None:
    columns = flight.columns("control", ["pos_world"], max_hz=20)
    assert len(columns) == 20 * DURATION_S
    assert np.allclose(np.diff(columns.times_s), 0.05)


def test_columns_of_a_channel_that_was_not_logged_are_empty(flight: Flight) -> None:
    columns = flight.columns("odometry", ["pos_world", "seq"])
    assert len(columns) == 0
    assert columns["pos_world"].shape == (0, 3)


def test_a_field_that_is_no_column_is_refused(flight: Flight) -> None:
    for field in ("covariance_upper", "no_such_field"):
        with pytest.raises(KeyError, match=field):
            flight.columns("target", [field])


def test_an_instant_shows_the_newest_record_at_or_before_it(flight: Flight) -> None:
    plan, frame = flight.plan_at(2.0), flight.frame_at(2.0)
    control, truth = flight.control_at(2.0), flight.truth_at(2.0)
    assert plan is not None and frame is not None and control is not None and truth is not None
    assert plan.seq == frame.seq == 2 * rec.FRAME_HZ
    assert control.stamp_ns == truth.stamp_ns == rec.START_NS + 2_000_000_000
    early = flight.plan_at(2.0 - 1e-3)
    assert early is not None
    assert early.seq == plan.seq - 1
    assert flight.control_at(-0.1) is None
    assert flight.health_at(2.0) is None


def test_instants_may_be_asked_for_in_any_order(flight: Flight) -> None:
    order = np.random.default_rng(0).permutation(flight.count("rgbd"))
    times_s = flight.times_s("rgbd")
    for seq in order:
        frame = flight.frame_at(times_s[int(seq)])
        assert frame is not None
        assert frame.seq == seq


def test_depth_becomes_points_ahead_of_the_camera(flight: Flight) -> None:
    frame = flight.frame_at(1.0)
    assert frame is not None
    seen = frame.points_cam_P3()
    assert seen is not None
    points_P3, colors_P3 = seen
    assert points_P3.shape == colors_P3.shape == (rec.WIDTH * rec.HEIGHT, 3)
    assert np.allclose(points_P3[:, 0], 4.0, atol=0.05)
    assert points_P3[0, 1] > 3.9 and points_P3[0, 2] > 2.3, "the first pixel is left and up"
    assert points_P3[-1, 1] < -3.9 and points_P3[-1, 2] < -2.3


def test_phases_follow_mode_and_target_without_gaps(flight: Flight) -> None:
    phases = flight.phases
    assert [p.name for p in phases] == ["take-off", "tracking", "lost", "search", "tracking", "landing"]
    assert [p.end_s for p in phases[:-1]] == [p.start_s for p in phases[1:]]
    starts_s = [p.start_s for p in phases]
    assert np.allclose(
        starts_s,
        [0, rec.TAKEOFF_S, rec.LOST_S + 0.5, rec.SEARCH_S, rec.FOUND_S, 7.0],
        atol=0.04,
    )
    (brake,) = flight.fallbacks
    assert (brake.name, brake.start_s, brake.end_s) == ("plan expired brake", 6.0, pytest.approx(6.2))


def test_tracking_without_any_estimate_is_lost() -> None:
    none = {"confirmed": np.zeros(0), "since_seen_s": np.zeros(0)}
    (phase,) = phases_of(np.arange(3.0), np.full(3, pb.MODE_TRACK), np.zeros(0), none)
    assert (phase.name, phase.start_s, phase.end_s) == ("lost", 0.0, 2.0)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.999])
def test_a_cut_off_log_holds_what_is_whole(path: Path, tmp_path: Path, flight: Flight, share: float) -> None:
    cut = tmp_path / "cut.mcap"
    whole = path.read_bytes()
    cut.write_bytes(whole[: int(share * len(whole))])
    part = Flight.open(cut)
    assert not part.closed
    assert part.count("control") > 0.8 * min(share, 0.9) * flight.count("control")
    assert np.array_equal(part.times_s("control"), flight.times_s("control")[: part.count("control")])
    last = part.frame_at(part.duration_s)
    assert last is not None
    assert last.seq == part.count("rgbd") - 1


def spoiled(path: Path, tmp_path: Path, at: int, over: bytes) -> Flight:
    """The log with some bytes written over."""
    damaged = tmp_path / "damaged.mcap"
    data = bytearray(path.read_bytes())
    data[at : at + len(over)] = over
    damaged.write_bytes(data)
    return Flight.open(damaged)


def test_a_damaged_log_is_read_around_a_hole_and_says_what_is_missing(
    path: Path, tmp_path: Path, flight: Flight
) -> None:
    part = spoiled(path, tmp_path, path.stat().st_size // 2, bytes(4096))
    assert part.closed
    (damage,) = part.log.damage
    assert damage.after_ns is not None and damage.before_ns is not None
    assert part.completeness.startswith("damaged: ") and "cut off" not in part.completeness
    whole, left = flight.times_s("control"), part.times_s("control")
    lost = np.setdiff1d(whole, left)
    assert 0 < len(lost) < 0.2 * len(whole)
    first_s, last_s = ((ns - part.start_ns) * 1e-9 for ns in (damage.after_ns, damage.before_ns))
    assert lost[0] >= first_s - 0.01 and lost[-1] <= last_s + 0.01
    assert part.duration_s == flight.duration_s
    assert any("damaged" in mark.text for mark in marks_of(part))


def test_a_log_without_its_first_chunk_takes_its_channels_from_the_summary(
    path: Path, tmp_path: Path, flight: Flight
) -> None:
    part = spoiled(path, tmp_path, 100, b"\xff" * 4096)
    assert 0.5 < part.count("control") / flight.count("control") < 1.0
    assert part.log.damage[0].after_ns is None
    assert set(part.log.schemas.values()) <= set(flight.log.schemas.values())


@pytest.mark.parametrize("offset", [1, 25, 45])
def test_a_length_of_2_to_the_48_is_damage_and_no_allocation(
    path: Path, tmp_path: Path, flight: Flight, offset: int
) -> None:
    """In a chunk's header: the record's length, the size unpacked, the size packed."""
    data = path.read_bytes()
    chunk = data.index(b"\x04\0\0\0zstd", len(data) // 2) - 37
    part = spoiled(path, tmp_path, chunk + offset, (1 << 48).to_bytes(8, "little"))
    assert len(part.missing) == 1
    assert part.count("control") > 0.8 * flight.count("control")


@pytest.mark.parametrize("seed", range(40))
def test_whatever_bits_flip_what_is_read_is_what_was_written(
    path: Path, tmp_path: Path, flight: Flight, seed: int
) -> None:
    data = bytearray(path.read_bytes())
    random = np.random.default_rng(seed)
    for at, bit in zip(random.integers(8, len(data), 50), random.integers(0, 8, 50), strict=True):
        data[at] ^= 1 << int(bit)
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    log = McapLog(damaged)
    assert log.damage
    assert sum(len(log.times_ns(topic)) for topic in log.topics) > 500
    for topic in log.topics:
        times = log.times_ns(topic)
        assert np.isin(times, flight.log.times_ns(topic)).all()
        if len(times):
            log.payload(topic, len(times) - 1)


def test_a_recovered_log_is_clean_and_holds_what_was_readable(path: Path, tmp_path: Path) -> None:
    part = spoiled(path, tmp_path, path.stat().st_size // 2, bytes(4096))
    done = recover(part.path, tmp_path / "clean.mcap")
    clean = Flight.open(done.path)
    assert (clean.completeness, done.missing) == ("complete", part.missing)
    assert done.records == sum(len(part.log.times_ns(topic)) for topic in part.log.topics)
    for channel in CHANNELS:
        assert np.array_equal(clean.log.times_ns(CHANNELS[channel][0]), part.log.times_ns(CHANNELS[channel][0]))
    with done.path.open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == done.records
    before = done.path.read_bytes()
    with pytest.raises(FileExistsError):
        recover(part.path, done.path)
    assert done.path.read_bytes() == before


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_a_recovery_that_is_broken_off_leaves_nothing_and_can_be_tried_again(
    failure: BaseException, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks_off(writer: Writer, *_: object) -> None:
        raise failure

    with monkeypatch.context() as patched, pytest.raises(type(failure)):
        patched.setattr(Writer, "add_message", breaks_off)
        recover(path, tmp_path / "clean.mcap")
    assert list(tmp_path.iterdir()) == []
    assert recover(path, tmp_path / "clean.mcap").records > 0
    assert list(tmp_path.iterdir()) == [tmp_path / "clean.mcap"]


def test_a_malformed_record_is_absent_and_counted(tmp_path: Path) -> None:
    file = tmp_path / "odd.mcap"
    log = rec.LogFile(file)
    log.write("control", rec.START_NS, rec.control(0.0, 0, 8.0))
    broken = rec.plan(0.0, 0)
    broken.duration_s = float("nan")
    log.write("plan", rec.START_NS, broken)
    log.close()
    flight = Flight.open(file)
    assert flight.plan_at(0.0) is None
    assert flight.malformed == 1


def test_what_is_no_flight_log_is_refused_in_one_line(path: Path, tmp_path: Path) -> None:
    def refused(name: str, content: bytes | None) -> str:
        file = tmp_path / name
        if content is not None:
            file.write_bytes(content)
        with pytest.raises(LogError) as caught:
            Flight.open(file)
        text = str(caught.value)
        assert str(file) in text and "\n" not in text
        return text

    assert "No such file" in refused("missing.mcap", None)
    assert "empty" in refused("empty.mcap", b"")
    assert "does not begin as an MCAP file" in refused("text.mcap", b"take-off, tracking, landing")
    assert "no whole record" in refused("stub.mcap", path.read_bytes()[:200])


def other_program(path: Path, compression: CompressionType, *, chunks: bool = True, topic: str = "/scan") -> Path:
    """A closed file that another program wrote."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunks)
        writer.start()
        channel = writer.register_channel(topic, "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    return path


@pytest.mark.parametrize("chunks", [True, False])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_another_programs_file_is_foreign_however_it_is_packed(
    compression: CompressionType, chunks: bool, tmp_path: Path
) -> None:
    path = other_program(tmp_path / "foreign.mcap", compression, chunks=chunks)
    with pytest.raises(ForeignLogError, match="none of its channels is Goshawk's"):
        Flight.open(path)
    assert header_of(path) is None


def test_a_log_of_ours_that_was_packed_anew_in_lz4_is_no_other_programs(tmp_path: Path) -> None:
    path = other_program(tmp_path / "ours.mcap", CompressionType.LZ4, topic="tel/control")
    with pytest.raises(LogError, match="no whole record") as refused:
        Flight.open(path)
    assert not isinstance(refused.value, ForeignLogError)


@pytest.mark.parametrize("protocol", [0, PROTOCOL - 1, PROTOCOL + 1])
def test_a_log_of_another_protocol_is_refused_in_one_line(tmp_path: Path, protocol: int) -> None:
    path = tmp_path / "flight.mcap"
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=protocol, version="0.0.9"))
    log.close()
    with pytest.raises(LogError, match=rf"protocol {protocol}, this software reads {PROTOCOL}.*\(0\.0\.9\)"):
        Flight.open(path)


def test_a_second_log_can_share_the_first_ones_clock(path: Path, flight: Flight) -> None:
    shifted = Flight.open(path, start_ns=flight.start_ns - 1_000_000_000)
    plan, same = shifted.plan_at(3.0), flight.plan_at(2.0)
    assert plan is not None and same is not None
    assert plan.seq == same.seq
