"""Who flies units: the cores of this machine. `on_ray` has the same for a cluster."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from pathlib import Path
from typing import Protocol

from goshawk_train.cluster.kit import Kit, temporary
from goshawk_train.cluster.plan import Unit
from goshawk_train.cluster.worker import Bench, Flown, UnitError
from goshawk_train.errors import TrainerError

AHEAD = 2
"""Units that wait for each core: so few that little is lost, enough that no core ever waits."""


class EngineError(TrainerError):
    """Units cannot be flown; the message says why and what to do."""


class Engine(Protocol):
    """Flies units in any order."""

    def fly(self, units: Iterable[Unit]) -> Iterator[tuple[Unit, Flown]]:
        """Each as soon as it is flown; raises `EngineError`."""
        ...

    def close(self) -> None:
        """Ends what flies."""
        ...


class Local:
    """A simulator for each core of this machine."""

    def __init__(self, kit: Kit, probe: list[str], workers: int | None) -> None:
        self.folder = temporary()
        self.bench = Bench(kit=kit.unpack(Path(self.folder.name)), probe=probe)
        self.workers = workers or len(os.sched_getaffinity(0))
        self.pool = ThreadPoolExecutor(self.workers)

    def fly(self, units: Iterable[Unit]) -> Iterator[tuple[Unit, Flown]]:
        """See `Engine`."""
        waiting, flying = iter(units), dict[Future[Flown], Unit]()
        while True:
            for unit in islice(waiting, AHEAD * self.workers - len(flying)):
                flying[self.pool.submit(self.bench.fly, unit.arguments)] = unit
            if not flying:
                return
            for future in wait(flying, return_when=FIRST_COMPLETED).done:
                try:
                    yield flying.pop(future), future.result()
                except UnitError as error:
                    raise EngineError(str(error)) from error

    def close(self) -> None:
        """See `Engine`."""
        self.bench.end()
        self.pool.shutdown(cancel_futures=True)
        self.folder.cleanup()
