"""Opens a flight's MCAP file and finds its records again: by channel, by time, without decoding them.

One walk over the file at opening; it ends quietly where the file was cut off (``kill -9``, a power cut, a full disk) or
is damaged, so what is whole can be read. Small records are kept in memory; images stay in the file, and their chunk is
unpacked again when one is asked for, with a few of the last chunks kept.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections import OrderedDict
from io import BytesIO
from pathlib import Path
from typing import TypeAlias

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray
from zstandard import ZstdDecompressor, ZstdError

MAGIC = b"\x89MCAP0\r\n"
KEPT_BYTES = 4096
"""Records up to this size are kept in memory, larger ones (images) as places in the file."""
CHUNKS_KEPT = 8
"""Unpacked chunks that are kept, about 1 MB each."""

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<H4xQ")
_MESSAGE_HEADER = 22
"""Channel, sequence, and the times of logging and publishing."""
_CHUNK = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")

Place: TypeAlias = tuple[int, int, int]
"""Chunk number, offset in it unpacked, length."""


class LogError(ValueError):
    """The file cannot be read as a flight log; one line that names it."""


class McapLog:
    """The records of one file. Read-only, and not safe to use from several threads at once."""

    def __init__(self, path: Path) -> None:
        """Raises LogError if the file cannot be read or is not MCAP at all."""
        self.path = path
        self.closed = False
        """Whether the writer finished the file; False: what follows the last whole chunk is lost."""
        self.schemas: dict[str, str] = {}
        """Topic → full name of its messages."""
        self._chunks: list[tuple[int, int]] = []
        self._unpacked: OrderedDict[int, bytes] = OrderedDict()
        self._zstd = ZstdDecompressor()
        self._schema_names: dict[int, str] = {}
        self._times: dict[str, list[int]] = {}
        self._records: dict[str, list[bytes | Place]] = {}
        self._sinks: dict[int, tuple[list[int], list[bytes | Place]]] = {}
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
        self._walk()
        self._sort()

    def close(self) -> None:
        """Lets go of the file; what is in memory stays readable."""
        self._file.close()

    @property
    def topics(self) -> tuple[str, ...]:
        """Every topic with at least one record, in the order of the file."""
        return tuple(self._records)

    def times_ns(self, topic: str) -> NDArray[np.int64]:
        """The time of each record, ascending; empty if there are none."""
        return self._sorted_times.get(topic, np.zeros(0, dtype=np.int64))

    def payload(self, topic: str, index: int) -> bytes:
        """One record's message, still encoded. Raises IndexError, KeyError if there is no such record."""
        record = self._records[topic][index]
        if isinstance(record, bytes):
            return record
        chunk, offset, length = record
        return self._chunk(chunk)[offset : offset + length]

    def _walk(self) -> None:
        at, size = len(MAGIC), len(self._file)
        while at + _RECORD.size <= size:
            opcode, length = _RECORD.unpack_from(self._file, at)
            begin, at = at + _RECORD.size, at + _RECORD.size + length
            if at > size or opcode == 0:
                return
            if opcode == Opcode.CHUNK:
                try:
                    data = self._unpack(begin, length)
                    self._index_chunk(data, len(self._chunks))
                except (ZstdError, McapError, ValueError, KeyError, struct.error):
                    return
                self._chunks.append((begin, length))
            elif opcode == Opcode.FOOTER:
                self.closed = True
                return

    def _unpack(self, begin: int, length: int) -> bytes:
        """A chunk's records. Raises ValueError, ZstdError or struct.error if it is damaged."""
        _, _, size, crc, name_length = _CHUNK.unpack_from(self._file, begin)
        at = begin + _CHUNK.size
        compression = self._file[at : at + name_length].decode()
        (packed_length,) = _LENGTH.unpack_from(self._file, at + name_length)
        at += name_length + _LENGTH.size
        if at + packed_length > begin + length:
            raise ValueError("a chunk is longer than its record")
        packed = memoryview(self._file)[at : at + packed_length]
        try:
            data = bytes(packed) if not compression else self._zstd.decompress(packed, max_output_size=size)
        finally:
            packed.release()
        if compression not in ("", "zstd") or len(data) != size or (crc and zlib.crc32(data) != crc):
            raise ValueError("a chunk is not what its checksum says")
        return data

    def _chunk(self, number: int) -> bytes:
        data = self._unpacked.pop(number, None)
        if data is None:
            data = self._unpack(*self._chunks[number])
        self._unpacked[number] = data
        if len(self._unpacked) > CHUNKS_KEPT:
            self._unpacked.popitem(last=False)
        return data

    def _index_chunk(self, data: bytes, number: int) -> None:
        at, size = 0, len(data)
        while at < size:
            opcode, length = _RECORD.unpack_from(data, at)
            begin = at + _RECORD.size
            at = begin + length
            if opcode == Opcode.MESSAGE:
                channel_id, time_ns = _MESSAGE.unpack_from(data, begin)
                begin += _MESSAGE_HEADER
                times, records = self._sinks[channel_id]
                times.append(time_ns)
                records.append(data[begin:at] if at - begin <= KEPT_BYTES else (number, begin, at - begin))
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(data[begin:at])))
                self._schema_names[schema.id] = schema.name
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(data[begin:at])))
                self.schemas[channel.topic] = self._schema_names.get(channel.schema_id, "")
                self._sinks[channel.id] = (
                    self._times.setdefault(channel.topic, []),
                    self._records.setdefault(channel.topic, []),
                )

    def _sort(self) -> None:
        """By time: the vehicle's threads hand over their records nearly, not exactly, in order."""
        self._sorted_times: dict[str, NDArray[np.int64]] = {}
        for topic, times in self._times.items():
            times_ns = np.array(times, dtype=np.int64)
            if (np.diff(times_ns) < 0).any():
                order = np.argsort(times_ns, kind="stable")
                times_ns = times_ns[order]
                records = self._records[topic]
                self._records[topic] = [records[k] for k in order]
            times_ns.setflags(write=False)
            self._sorted_times[topic] = times_ns
        self._times.clear()
