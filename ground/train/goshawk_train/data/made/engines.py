"""Who makes scenes: the cores of this machine, or those of a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

from goshawk_train.data import DataError
from goshawk_train.data.made import scene
from goshawk_train.data.made.scene import Files, Makers, Recipe, SceneError, make_on_node

AHEAD = 2
"""Scenes that are asked for at once, for each core: so few that little memory is held, enough that no core waits."""
QUIET = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
"""Before Ray is imported: it tells nobody that it is used, and warns of no accelerators."""


class Engine(Protocol):
    """Makes scenes in any order."""

    def make(self, scenes: Iterable[int]) -> Iterator[tuple[int, Files]]:
        """Each as soon as it is made; raises `DataError`."""
        ...

    def close(self) -> None:
        """Ends what is being made."""
        ...


class Local:
    """A simulator for each core of this machine."""

    def __init__(self, simulator: Path, recipe: Recipe, workers: int | None) -> None:
        self.simulator, self.recipe, self.makers = simulator, recipe, Makers()
        self.workers = workers or len(os.sched_getaffinity(0))
        self.pool = ThreadPoolExecutor(self.workers)

    def make(self, scenes: Iterable[int]) -> Iterator[tuple[int, Files]]:
        """See `Engine`."""
        waiting, making = iter(scenes), dict[Future[Files], int]()
        while True:
            for number in islice(waiting, AHEAD * self.workers - len(making)):
                making[self.pool.submit(self.makers.make, self.simulator, self.recipe, number)] = number
            if not making:
                return
            for future in wait(making, return_when=FIRST_COMPLETED).done:
                try:
                    yield making.pop(future), future.result()
                except SceneError as error:
                    raise DataError(str(error)) from error

    def close(self) -> None:
        """See `Engine`."""
        self.makers.end()
        self.pool.shutdown(cancel_futures=True)


class OnRay:
    """A simulator for each core of a cluster. A node needs Ray and this version of Python, nothing else: Ray carries
    `scene` there, and the simulator. What a lost worker or node was making, it has made again."""

    def __init__(self, simulator: Path, recipe: Recipe, workers: int | None, address: str | None) -> None:
        os.environ.update(QUIET)
        try:
            import ray as typeless
        except ModuleNotFoundError as error:
            raise DataError("Ray is not installed: make setup-campaign") from error

        here: dict[str, Any] = {"num_cpus": workers or len(os.sched_getaffinity(0)), "include_dashboard": False}
        options = {"log_to_driver": False, "logging_level": "ERROR", **({} if address else here)}
        self.ray: Any = typeless
        try:
            self.ray.init(address or "local", **options)
        except Exception as error:  # of no class of its own, when a node is slow to begin
            first = str(error).splitlines()[0]
            raise DataError(f"no Ray at {address or 'this machine'}: {first}; see ray status") from error
        self.ray.cloudpickle.register_pickle_by_value(scene)  # what nodes run comes with the call
        self.program, self.recipe = self.ray.put(simulator.read_bytes()), recipe
        self.remote = self.ray.remote(make_on_node).options(num_cpus=1, max_retries=-1)

    def make(self, scenes: Iterable[int]) -> Iterator[tuple[int, Files]]:
        """See `Engine`."""
        ray, waiting, making = self.ray, iter(scenes), dict[Any, int]()
        while True:
            # Nodes come and go.
            room = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1))) - len(making)
            for number in islice(waiting, max(0, room)):
                making[self.remote.remote([self.program], self.recipe, number)] = number
            if not making:
                return
            done, _ = ray.wait(list(making), timeout=1.0)
            for made in done:
                try:
                    yield making.pop(made), ray.get(made)
                except ray.exceptions.RayTaskError as error:
                    raise DataError(f"a worker failed: {error.cause}") from error
                except ray.exceptions.RayError as error:
                    raise DataError(f"Ray: {str(error).splitlines()[0]}") from error

    def close(self) -> None:
        """See `Engine`."""
        self.ray.shutdown()
