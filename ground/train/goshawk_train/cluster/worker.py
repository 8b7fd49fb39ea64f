"""Flies one unit, wherever that is: it needs Python's own library and a kit. Ray carries this file to its nodes."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import shutil
import signal
import subprocess
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PROGRAM = "program/goshawk-sim"
"""The simulator's place in a kit."""


class UnitError(Exception):
    """The simulator would not fly; the message is its own last line."""


@dataclass(frozen=True, kw_only=True)
class Processor:
    """What decides how numbers are rounded where a unit was flown."""

    node: str
    model: str
    flags_sha256: str
    flight_sha256: str
    """Of one flight that all processors fly: the same, or floating point differs."""

    def __str__(self) -> str:
        return f"{self.node} ({self.model}, flags {self.flags_sha256[:8]}, flight {self.flight_sha256[:8]})"


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of a unit."""

    records: bytes
    """What `goshawk-sim fly --records` wrote."""
    seconds: float
    """Of one core: what it cost, however busy the machine was."""
    processor: Processor


@dataclass(kw_only=True)
class Bench:
    """Where one process flies: an unpacked kit, what its processor is, and the simulators that run."""

    kit: Path
    probe: list[str]
    """The arguments of the flight that all processors fly."""
    processor: Processor | None = None
    running: set[int] = field(default_factory=set[int])
    ended: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock)

    def fly(self, arguments: list[str]) -> Flown:
        """One unit; raises `UnitError`."""
        with self.lock:
            # Once for all, before the first unit.
            if self.processor is None:
                self.processor = read_processor(self._records(self.probe)[0])
        records, seconds = self._records(arguments)
        return Flown(records=records, seconds=seconds, processor=self.processor)

    def end(self) -> None:
        """Ends what flies; nothing more begins."""
        self.ended = True
        for process in list(self.running):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)

    def _records(self, arguments: list[str]) -> tuple[bytes, float]:
        with tempfile.TemporaryDirectory(prefix="goshawk-unit-") as scratch:
            out, words = Path(scratch) / "records", Path(scratch) / "words"
            command = [str(self.kit / PROGRAM), *arguments, "--threads", "1", "--records", str(out)]
            with words.open("wb") as said:
                # A session of its own: Ctrl-C is the driver's, which ends it in order.
                child = subprocess.Popen(
                    command, cwd=self.kit, stdout=subprocess.DEVNULL, stderr=said, start_new_session=True
                )
            self.running.add(child.pid)
            if self.ended:
                child.kill()
            # Not by `child`, which does not say what the unit cost.
            _, status, used = os.wait4(child.pid, 0)
            self.running.discard(child.pid)
            child.returncode = os.waitstatus_to_exitcode(status)
            if child.returncode:
                last = last_words(words.read_text(errors="replace"), child.returncode)
                raise UnitError(f"{last} (goshawk-sim {' '.join(arguments)})")
            return out.read_bytes(), used.ru_utime + used.ru_stime


def last_words(said: str, status: int) -> str:
    """Of a simulator that failed: the line that says why, not the hint to --help that follows a bad option."""
    lines = said.strip().splitlines() or [f"status {status}"]
    return next((line for line in lines if line.startswith("error")), lines[-1])


def read_processor(flight: bytes) -> Processor:
    """This machine's, which flew that."""
    info: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            name, _, value = line.partition(":")
            info.setdefault(name.strip(), value.strip())
    except OSError:
        pass  # not a Linux: the flight tells them apart
    flags = " ".join(sorted((info.get("flags") or info.get("Features") or "").split()))
    return Processor(
        node=platform.node(),
        model=info.get("model name") or platform.processor() or platform.machine(),
        flags_sha256=hashlib.sha256(flags.encode()).hexdigest(),
        flight_sha256=hashlib.sha256(flight).hexdigest(),
    )


def unpack(files: dict[str, bytes], folder: Path) -> Path:
    """A kit's files in a folder that is whole or not there, for all processes of this user on this machine."""
    partial = Path(tempfile.mkdtemp(prefix=f"{folder.name}-", dir=folder.parent))
    for name, content in files.items():
        path = partial / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    (partial / PROGRAM).chmod(0o755)
    try:
        partial.rename(folder)
    except OSError:
        shutil.rmtree(partial)  # another process was faster
    return folder


_benches: dict[str, Bench] = {}
"""Of a Ray worker's process, by the kits' digests."""


def fly_on_node(digest: str, files: list[Any], probe: list[str], arguments: list[str]) -> Flown:
    """A unit in a process of a Ray node. `files` holds the reference to the kit's contents: they come once a node."""
    if digest not in _benches:
        folder = Path(tempfile.gettempdir()) / f"goshawk-kit-{os.getuid()}-{digest[:16]}"
        if not folder.is_dir():
            import ray

            content: Any = ray.get(files[0])
            unpack(content, folder)
        if folder.stat().st_uid != os.getuid():
            raise UnitError(f"{folder} is another user's, so nothing of it is run: remove it")
        _benches[digest] = Bench(kit=folder, probe=probe)
    return _benches[digest].fly(arguments)
