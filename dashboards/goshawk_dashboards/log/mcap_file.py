"""Opens a flight's MCAP file and finds its records again: by channel, by time, without decoding them.

One walk over the file at opening; it ends quietly where the file was cut off (``kill -9``, a power cut, a full disk).
What is damaged is left out and named: after it the walk goes on at the next chunk whose lengths fit and whose
checksum is right. A wrong length leads nowhere, and no more is allocated than the file and CHUNK_LIMIT.

However long the log is, memory holds where each record is (20 bytes), some small records (the others wait in a file
without a name), and a few whole chunks, for their images. These are unpacked again when they are asked for.
"""

from __future__ import annotations

import copy
import itertools
import mmap
import struct
import zlib
from array import array
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TypeAlias

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Schema
from numpy.typing import NDArray
from zstandard import ZstdDecompressor, ZstdError

from goshawk_dashboards.log.progress import Progress, unheard
from goshawk_dashboards.log.small import SmallRecords

MAGIC = b"\x89MCAP0\r\n"
SMALL_BYTES = 4096
"""Records up to this size are kept apart from the larger ones (images), which are most of a chunk."""
CHUNKS_KEPT = 8
"""Unpacked chunks that are kept, about 1 MB each."""

CHUNK_LIMIT = 64 << 20
"""A chunk holds at most so much unpacked; the vehicle's end at 1 MB and the record that exceeds it."""
BEGINNING = 1000
"""Messages among which a header is looked for: it is the first, unless another tool has sorted them."""

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<H4xQ")
_SEQUENCE = struct.Struct("<HIQ")
_MESSAGE_HEADER = 22
"""Channel, sequence, and the times of logging and publishing."""
_CHUNK = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")
_TIMES = struct.Struct("<QQ")
_LAST_OPCODE = Opcode.DATA_END
_LAST_NS = 2**63 - 1
"""A later time, three centuries after the vehicle's start, is damage."""
_ZSTD = b"\x04\0\0\0zstd"
"""The compression's name as it stands in a chunk's header,"""
_TO_ZSTD = _RECORD.size + 28
"""and where, from the begin of the record."""
_FOOTER = _RECORD.pack(Opcode.FOOTER, 20)

Places: TypeAlias = NDArray[np.int32]
"""A row a record: chunk number, offset, length. Offset in the chunk unpacked, or of a small record in the chunk's small
records."""


class LogError(ValueError):
    """The file cannot be read as a flight log; one line that names it."""


class ForeignLogError(LogError):
    """It is whole and MCAP, but another program's: an export lies beside its log."""


@dataclass(frozen=True, kw_only=True)
class Damage:
    """A part of a file that cannot be read."""

    begin: int
    """The first byte that is in doubt: what is before it is whole."""
    end: int
    after_ns: int | None
    """The last record's time before it; None: it is at the log's begin."""
    before_ns: int | None
    """The first record's time after it; None: nothing whole follows."""


class McapLog:
    """The records of one file. Read-only, and not safe to use from several threads at once."""

    def __init__(self, path: Path, progress: Progress = unheard) -> None:
        """Raises LogError if the file cannot be read or is not MCAP at all; ``progress`` hears of bytes."""
        self.path = path
        self.closed = False
        """Whether the writer finished the file; False: what follows the last whole chunk is lost."""
        self.damage: tuple[Damage, ...] = ()
        """What cannot be read, in the order of the file; empty: the file is whole, or was only cut off."""
        self.schemas: dict[str, str] = {}
        """Topic → full name of its messages."""
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._summary: dict[int, Channel] = {}
        self._chunks: list[tuple[int, int]] = []
        self._unpacked: OrderedDict[int, bytes] = OrderedDict()
        self._zstd = ZstdDecompressor()
        self._small = SmallRecords()
        self._sorted_times: dict[str, NDArray[np.int64]] = {}
        self._places: dict[str, Places] = {}
        self._found: dict[str, tuple[array[int], array[int]]] = {}
        """Topic → times and places, one after the other, until they are sorted."""
        self._sinks: dict[int, tuple[array[int], array[int]]] = {}
        """Channel id → where its records go."""
        try:
            with path.open("rb") as file:
                self._file = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or "it is empty"
            raise LogError(f"cannot read {path}: {why}") from error
        if self._file[: len(MAGIC)] != MAGIC:
            self._file.close()
            raise LogError(f"{path} is no flight log: it does not begin as an MCAP file")
        try:
            self._walk(progress)
        except OSError as error:
            raise LogError(f"cannot read {path}: {self._small.folder} has no room for it: {error.strerror}") from error
        self._sort()

    def again(self) -> McapLog:
        """The same log for another thread, without a second walk; what was found is shared."""
        other = copy.copy(self)
        other._unpacked, other._zstd = OrderedDict(), ZstdDecompressor()
        return other

    def close(self) -> None:
        """Lets go of the file; what is in memory stays readable."""
        self._file.close()

    @property
    def topics(self) -> tuple[str, ...]:
        """Every topic with at least one record, in the order of the file."""
        return tuple(topic for topic, places in self._places.items() if len(places))

    @property
    def declared(self) -> frozenset[str]:
        """Topics of the summary; empty if the file was cut off."""
        return frozenset(channel.topic for channel in self._summary.values())

    def times_ns(self, topic: str) -> NDArray[np.int64]:
        """The time of each record, ascending; empty if there are none."""
        return self._sorted_times.get(topic, np.zeros(0, dtype=np.int64))

    def payload(self, topic: str, index: int) -> bytes:
        """One record's message, still encoded. Raises IndexError, KeyError if there is no such record."""
        chunk, offset, length = self._places[topic][index].tolist()
        data = self._small.of(chunk) if length <= SMALL_BYTES else self._chunk(chunk)
        return data[offset : offset + length]

    def records(self) -> Iterator[tuple[Channel, int, int, bytes]]:
        """Every readable record in the order of writing: its channel, sequence, time and message."""
        for number in range(len(self._chunks)):
            data = self._chunk(number)
            for opcode, begin, length in _records(data, 0, len(data)):
                if opcode != Opcode.MESSAGE or length < _MESSAGE_HEADER:
                    continue
                channel_id, sequence, time_ns = _SEQUENCE.unpack_from(data, begin)
                if channel_id in self._channels and time_ns <= _LAST_NS:
                    payload = data[begin + _MESSAGE_HEADER : begin + length]
                    yield self._channels[channel_id], sequence, time_ns, payload

    def schema_of(self, channel: Channel) -> Schema | None:
        """The schema of a channel's messages; None if it was lost."""
        return self._schemas.get(channel.schema_id)

    def _walk(self, progress: Progress) -> None:
        """Takes every whole chunk; what lies between two must be records from begin to end, or it is damage."""
        footer_at = len(self._file) - len(_FOOTER) - 20 - len(MAGIC)
        footer = self._file[max(0, footer_at) : footer_at + len(_FOOTER)]
        self.closed = self._file[-len(MAGIC) :] == MAGIC and footer == _FOOTER
        if self.closed:
            self._read_summary(_LENGTH.unpack_from(self._file, footer_at + len(_FOOTER))[0], footer_at)
        end = footer_at if self.closed else len(self._file)
        damage: list[Damage] = []
        whole_to, after_ns = len(MAGIC), None
        while (found := self._next_chunk(whole_to, end)) is not None:
            at, length, data = found
            first_ns, last_ns = _TIMES.unpack_from(self._file, at + _RECORD.size)
            if self._chain(self._file, whole_to, at) != at:
                damage.append(Damage(begin=whole_to, end=at, after_ns=after_ns, before_ns=first_ns))
            self._index_chunk(data, len(self._chunks))
            self._chunks.append((at + _RECORD.size, length))
            self._let_go(whole_to, at + _RECORD.size + length)
            whole_to, after_ns = at + _RECORD.size + length, last_ns
            progress("reading", whole_to, end)
        progress("reading", end, end)
        # What was cut off ends within a record; a damaged file has its end, or a chunk that is all there but not whole.
        spoiled = any(self._chunk_length(at, end) for at in self._candidates(whole_to, end))
        if spoiled or (self.closed and self._chain(self._file, whole_to, end) != end):
            damage.append(Damage(begin=whole_to, end=end, after_ns=after_ns, before_ns=None))
        self.damage = tuple(damage)

    def _next_chunk(self, begin: int, end: int) -> tuple[int, int, bytes] | None:
        """The next whole chunk: where it begins, its record's length, its records; None: there is no more."""
        for at in self._candidates(begin, end):
            length = self._chunk_length(at, end)
            if length is None:
                continue
            try:
                data = self._unpack(at + _RECORD.size, length)
            except (ZstdError, MemoryError, ValueError, struct.error):
                continue
            if self._chain(data, 0, len(data)) == len(data):
                return at, length, data
        return None

    def _candidates(self, begin: int, end: int) -> Iterator[int]:
        """Where a chunk may begin: where the records before it end, then wherever zstd's name stands as in a header."""
        chained = self._chain(self._file, begin, end)
        yield chained
        at = begin + _TO_ZSTD
        while (at := self._file.find(_ZSTD, at, end)) >= 0:
            if at - _TO_ZSTD != chained:
                yield at - _TO_ZSTD
            at += 1

    def _chunk_length(self, at: int, end: int) -> int | None:
        """The length of the chunk record at a place; None: there is none, or its lengths contradict each other."""
        if at + _TO_ZSTD + 4 > end:
            return None
        opcode, length = _RECORD.unpack_from(self._file, at)
        _, _, size, _, name_length = _CHUNK.unpack_from(self._file, at + _RECORD.size)
        fits = opcode == Opcode.CHUNK and at + _RECORD.size + length <= end and size <= CHUNK_LIMIT
        if not fits or _CHUNK.size + name_length + _LENGTH.size > length:
            return None
        (packed,) = _LENGTH.unpack_from(self._file, at + _RECORD.size + _CHUNK.size + name_length)
        return length if _CHUNK.size + name_length + _LENGTH.size + packed == length else None

    @staticmethod
    def _chain(data: bytes | mmap.mmap, at: int, end: int) -> int:
        """Where the records that begin at a place end: at a chunk, or at what is no record."""
        while at + _RECORD.size <= end:
            opcode, length = _RECORD.unpack_from(data, at)
            if not 0 < opcode <= _LAST_OPCODE or opcode == Opcode.CHUNK or at + _RECORD.size + length > end:
                break
            at += _RECORD.size + length
        return at

    def _unpack(self, begin: int, length: int) -> bytes:
        """A chunk's records. Raises ValueError, ZstdError or struct.error if it is damaged."""
        _, _, size, crc, name_length = _CHUNK.unpack_from(self._file, begin)
        at = begin + _CHUNK.size
        compression = self._file[at : at + name_length]
        (packed_length,) = _LENGTH.unpack_from(self._file, at + name_length)
        at += name_length + _LENGTH.size
        if at + packed_length > begin + length:
            raise ValueError("a chunk is longer than its record")
        packed = memoryview(self._file)[at : at + packed_length]
        try:
            # The frame's own size is what would be allocated.
            if compression and zstandard.frame_content_size(packed) not in (-1, size):
                raise ValueError("a chunk is not of the size that it says")
            data = bytes(packed) if not compression else self._zstd.decompress(packed, max_output_size=size)
        finally:
            packed.release()
        if compression not in (b"", b"zstd") or len(data) != size or (crc and zlib.crc32(data) != crc):
            raise ValueError("a chunk is not what its checksum says")
        return data

    def _chunk(self, number: int) -> bytes:
        data = self._unpacked.pop(number, None)
        if data is None:
            begin, length = self._chunks[number]
            data = self._unpack(begin, length)
            self._let_go(begin, begin + length)
        self._unpacked[number] = data
        if len(self._unpacked) > CHUNKS_KEPT:
            self._unpacked.popitem(last=False)
        return data

    def _let_go(self, begin: int, end: int) -> None:
        """The pages of a part that was read need not stay in memory: a mapped file would grow to its whole size."""
        begin -= begin % mmap.PAGESIZE
        self._file.madvise(mmap.MADV_DONTNEED, begin, end - begin)

    def _read_summary(self, begin: int, end: int) -> None:
        """The summary repeats the channels: for those whose first chunk is lost."""
        for opcode, at, length in _records(self._file, begin, end):
            if opcode == Opcode.SCHEMA:
                self._take_schema(self._file[at : at + length])
            elif opcode == Opcode.CHANNEL and (channel := _channel(self._file[at : at + length])) is not None:
                self._summary[channel.id] = channel

    def _index_chunk(self, data: bytes, number: int) -> None:
        small = bytearray()
        for opcode, begin, length in _records(data, 0, len(data)):
            if opcode == Opcode.MESSAGE and length >= _MESSAGE_HEADER:
                channel_id, time_ns = _MESSAGE.unpack_from(data, begin)
                end, begin = begin + length, begin + _MESSAGE_HEADER
                at = begin
                if end - begin <= SMALL_BYTES:
                    at = len(small)
                    small += data[begin:end]
                sink = self._sinks.get(channel_id) or self._declare(self._summary.get(channel_id))
                if sink is None or time_ns > _LAST_NS:
                    continue  # its channel was lost with what was damaged or cut off before, or its time is none
                sink[0].append(time_ns)
                sink[1].extend((number, at, end - begin))
            elif opcode == Opcode.SCHEMA:
                self._take_schema(data[begin : begin + length])
            elif opcode == Opcode.CHANNEL:
                self._declare(_channel(data[begin : begin + length]))
        self._small.append(small)

    def _take_schema(self, content: bytes) -> None:
        schema = _schema(content)
        if schema is not None:
            self._schemas[schema.id] = schema

    def _declare(self, channel: Channel | None) -> tuple[array[int], array[int]] | None:
        if channel is None:
            return None
        schema = self.schema_of(channel)
        self.schemas[channel.topic] = "" if schema is None else schema.name
        topic, self._channels[channel.id] = channel.topic, channel
        self._sinks[channel.id] = self._found.setdefault(topic, (array("q"), array("i")))
        return self._sinks[channel.id]

    def _sort(self) -> None:
        """By time: the vehicle's threads hand over their records nearly, not exactly, in order."""
        for topic, (times, places) in self._found.items():
            times_ns = np.array(times, dtype=np.int64)
            self._places[topic] = np.array(places, dtype=np.int32).reshape(-1, 3)
            if (np.diff(times_ns) < 0).any():
                order = np.argsort(times_ns, kind="stable")
                times_ns = times_ns[order]
                self._places[topic] = self._places[topic][order]
            times_ns.setflags(write=False)
            self._sorted_times[topic] = times_ns
        self._found.clear()
        self._sinks.clear()


def first_message(path: Path, topic: str) -> bytes:
    """The first message of a topic, of a file that is read no farther than to it, and not far for it. Raises LogError
    if none is found."""
    try:
        with path.open("rb") as file:
            reader = NonSeekingReader(file, record_size_limit=CHUNK_LIMIT)
            for _, channel, message in itertools.islice(reader.iter_messages(log_time_order=False), BEGINNING):
                if channel.topic == topic:
                    return message.data
    except (OSError, McapError, ZstdError, ValueError, struct.error, MemoryError, OverflowError, RuntimeError) as error:
        raise LogError(f"cannot read {path}: {error}") from error
    raise LogError(f"{path} does not begin with {topic}")


def _channel(content: bytes) -> Channel | None:
    """None if the record is damaged."""
    try:
        return Channel.read(ReadDataStream(BytesIO(content)))
    except (McapError, ValueError, struct.error):
        return None


def _schema(content: bytes) -> Schema | None:
    """None if the record is damaged."""
    try:
        return Schema.read(ReadDataStream(BytesIO(content)))
    except (McapError, ValueError, struct.error):
        return None


def _records(data: bytes | mmap.mmap, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, place and length of each record's content; ends at the first that does not fit."""
    while at >= 0 and at + _RECORD.size <= end:
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if at + length > end:
            return
        yield opcode, at, length
        at += length
