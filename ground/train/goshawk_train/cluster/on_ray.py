"""Units on Ray: on this machine, or on a cluster that runs. Ray flies again what a lost worker or node was flying.

A node needs Ray and this version of Python, nothing else: Ray carries `worker` there, and the kit.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import goshawk_train
from goshawk_train.cluster.engines import AHEAD, EngineError
from goshawk_train.cluster.kit import Kit
from goshawk_train.cluster.plan import Unit
from goshawk_train.cluster.worker import Flown, UnitError, fly_on_node

SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_worker_niceness": "0",
    "RAY_DISABLE_FAILURE_SIGNAL_HANDLER": "1",
}
"""Before Ray is imported: it tells nobody that it is used, warns of no accelerators, flies as fast as the rest, and
ends without a stack trace when it is told to."""


class OnRay:
    """A simulator for each core of a cluster."""

    def __init__(self, kit: Kit, probe: list[str], workers: int | None, address: str | None) -> None:
        os.environ.update(SETTINGS)
        import ray as typeless

        here: dict[str, Any] = (
            {} if address else {"num_cpus": workers or len(os.sched_getaffinity(0)), "include_dashboard": False}
        )
        sent = {"py_modules": [str(Path(goshawk_train.__file__).parent)]}
        self.ray: Any = typeless
        try:
            self.ray.init(address or "local", log_to_driver=False, logging_level="ERROR", runtime_env=sent, **here)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise EngineError(f"no Ray at {address}: {str(error).splitlines()[0]}; begin one by ray start") from error
        self.files = self.ray.put(kit.bytes())
        self.digest, self.probe = kit.digest, probe
        # A unit is idempotent: whatever dies under it, it is flown again.
        self.remote = self.ray.remote(fly_on_node).options(num_cpus=1, max_retries=-1)

    def fly(self, units: Iterable[Unit]) -> Iterator[tuple[Unit, Flown]]:
        """See `engines.Engine`."""
        ray, waiting, flying = self.ray, iter(units), dict[Any, Unit]()
        while True:
            # Nodes come and go.
            room = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1))) - len(flying)
            for unit in islice(waiting, max(0, room)):
                flying[self.remote.remote(self.digest, [self.files], self.probe, unit.arguments)] = unit
            if not flying:
                return
            done, _ = ray.wait(list(flying), timeout=1.0)
            for ref in done:
                try:
                    yield flying.pop(ref), ray.get(ref)
                except ray.exceptions.RayTaskError as error:
                    if isinstance(error.cause, UnitError):
                        raise EngineError(str(error.cause)) from error
                    raise EngineError(f"a worker failed: {error.cause!r}") from error
                except ray.exceptions.RayError as error:
                    raise EngineError(f"Ray: {str(error).splitlines()[0]}") from error

    def close(self) -> None:
        """See `engines.Engine`."""
        self.ray.shutdown()
