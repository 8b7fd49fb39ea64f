"""A flight log written on board is read by the stock Python packages, also when its writer was killed."""

import io
import os
import struct
import subprocess
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image

REPOSITORY = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 160, 96


@pytest.fixture(scope="module")
def write_log() -> Path:
    """The built example that writes logs."""
    build = ["cargo", "build", "-q", "--release", "--locked", "--workspace", "--bins", "--examples"]
    subprocess.run(build, cwd=REPOSITORY, check=True)
    return Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"), "release", "examples", "write_log")


def test_a_closed_log_has_a_summary_with_every_channel_and_schema(write_log: Path, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    subprocess.run([write_log, path, "200"], check=True)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == 1 + 200 + 50
    schemas = {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    assert {topic: (schema.name, schema.encoding) for topic, schema in schemas.items()} == {
        "log/header": ("goshawk.v1.LogHeader", "protobuf"),
        "tel/control": ("goshawk.v1.Control", "protobuf"),
        "log/rgbd": ("goshawk.v1.CompressedRgbd", "protobuf"),
    }
    assert {index.compression for index in summary.chunk_indexes} == {"zstd"}


def test_messages_and_images_come_back_without_our_own_code(write_log: Path, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    subprocess.run([write_log, path, "200"], check=True)
    counts: Counter[str] = Counter()
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            seq = counts[channel.topic]
            assert message.sequence == seq
            if channel.topic == "tel/control":
                assert (decoded.seq, decoded.stamp_ns, message.log_time) == (seq, seq * 10_000_000, seq * 10_000_000)
                assert (decoded.pos_world.x, decoded.pos_world.y, decoded.pos_world.z) == (seq, 0.5, 2.0)
            elif channel.topic == "log/rgbd":
                assert_image(decoded.rgb_png, decoded.depth_png, seq=4 * seq)
            counts[channel.topic] += 1
    assert counts == {"log/header": 1, "tel/control": 200, "log/rgbd": 50}


def assert_image(rgb_png: bytes, depth_png: bytes, *, seq: int) -> None:
    """The example's frame `seq`, without loss."""
    depth = np.asarray(Image.open(io.BytesIO(depth_png))).astype(np.int64)
    assert np.array_equal(depth, np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) + seq)
    rgb = np.asarray(Image.open(io.BytesIO(rgb_png))).astype(np.int64)
    planes = np.arange(WIDTH)[None, :], np.array([[100]]), np.full((HEIGHT, 1), seq % 256)
    expected = np.stack(np.broadcast_arrays(*planes), axis=-1)
    assert np.array_equal(rgb, expected)


def test_a_log_whose_writer_was_killed_lacks_at_most_its_last_second(write_log: Path, tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    writer = subprocess.Popen([write_log, path])
    started = time.monotonic()
    while time.monotonic() - started < 3:
        assert writer.poll() is None
        time.sleep(0.1)
    writer.kill()
    writer.wait()
    seqs: list[int] = []
    with path.open("rb") as stream:
        reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
        messages = reader.iter_decoded_messages(topics=["tel/control"], log_time_order=False)
        with pytest.raises((McapError, EOFError, ValueError, struct.error)):  # the file has no end
            for _, _, _, decoded in messages:
                seqs.append(decoded.seq)
    assert seqs == list(range(len(seqs)))
    assert len(seqs) >= 150  # of 300 written; the process may have started late
