"""A log's small records, as they are asked for most: apart from its images, and all of them, however long it is."""

from __future__ import annotations

import os
import tempfile
import threading
from array import array
from collections import OrderedDict
from pathlib import Path

HELD_BYTES = 96 << 20
"""In memory, all of about five minutes of flight; more of them go to a file without a name."""
RECENT = 8
"""Chunks whose records are at hand."""
ROOMY = Path("/var/tmp")
"""Where large files for a while belong: /tmp may be memory."""


class SmallRecords:
    """Appended chunk by chunk, then read; several threads may. Raises OSError where there is no room for them."""

    def __init__(self) -> None:
        self.folder = str(ROOMY) if "TMPDIR" not in os.environ and ROOMY.is_dir() else tempfile.gettempdir()
        """Where they go that are too many for memory; the environment's TMPDIR names another."""
        self._file = tempfile.SpooledTemporaryFile(HELD_BYTES, dir=self.folder)  # noqa: SIM115
        self._ends = array("q", [0])
        """Where the records of each chunk end in it; the first begin at 0."""
        self._recent: OrderedDict[int, bytes] = OrderedDict()
        self._lock = threading.Lock()

    def append(self, records: bytes | bytearray) -> None:
        """Those of the next chunk, one after the other."""
        self._file.write(records)
        self._ends.append(self._ends[-1] + len(records))

    def of(self, chunk: int) -> bytes:
        """Those of one chunk. Raises IndexError if there is no such chunk."""
        with self._lock:
            records = self._recent.pop(chunk, None)
            if records is None:
                self._file.seek(self._ends[chunk])
                records = self._file.read(self._ends[chunk + 1] - self._ends[chunk])
            self._recent[chunk] = records
            if len(self._recent) > RECENT:
                self._recent.popitem(last=False)
            return records
