"""What `--record` keeps: a file each time that the camera is opened, and a word when a file takes no more."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import chain, count
from pathlib import Path

Say = Callable[[str], None]


class Recorder:
    """The files of one run. Once one of them could not be finished, nothing more is recorded: images are sent on."""

    def __init__(self, file: Path, say: Say) -> None:
        self._file, self._say = file, say
        self._last: RecordedFile | None = None
        self.incomplete: str | None = None
        """What is wrong with the recording; None: nothing."""

    @property
    def begun(self) -> bool:
        """Whether a file was begun."""
        return self._last is not None

    def next_file(self) -> RecordedFile | None:
        """A file of its own for the camera that is opened now: none is overwritten. None: nothing is recorded."""
        return None if self.incomplete else RecordedFile(unused(self._file), self)

    def took(self, file: RecordedFile) -> None:
        """The file was begun."""
        self._last = file

    def gave_up(self, path: Path, kept: str, why: str) -> None:
        """The recording lacks whatever comes now. It is said once."""
        if self.incomplete is None:
            self.incomplete = f"the recording is incomplete: {path} {kept}"
            self._say(f"{self.incomplete} ({why}). Images are sent on. Make room on its disk, and record anew")


class RecordedFile:
    """A file that librealsense writes, on a thread of its own."""

    def __init__(self, path: Path, recorder: Recorder) -> None:
        self.path, self._recorder = path, recorder
        self._begun_s = time.monotonic()
        self._failure: tuple[float, str] | None = None

    def begun(self) -> None:
        """The camera streams into it from now on."""
        self._begun_s = time.monotonic()
        self._recorder.took(self)

    def fail(self, why: str) -> None:
        """It takes no more. From any thread; the first reason counts, what follows comes of it."""
        if self._failure is None:
            self._failure = time.monotonic(), why

    def look(self) -> None:
        """Says so if it has failed. From the thread that reads the images."""
        if self._failure is not None:
            failed_s, why = self._failure
            self._recorder.gave_up(self.path, f"keeps the first {failed_s - self._begun_s:.1f} s", why)


def unused(file: Path) -> Path:
    """It, or the first of `walk-2`, `walk-3` and so on that does not exist."""
    others = (file.with_stem(f"{file.stem}-{number}") for number in count(2))
    return next(each for each in chain((file,), others) if not each.exists())
