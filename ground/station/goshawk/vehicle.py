"""One vehicle, for asyncio: a thin layer over the ground's own link, so that a program has no way of its own to fly.

Start asks as `goshawk start` does, Stop as `goshawk stop`: under one id until the vehicle confirms it.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Self

from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import CommandView, EventView, HealthView
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, GroundLink, LinkError
from goshawk_ground.link.recording import record

POLL_S = 0.02
EVENTS = 200
"""Events that may wait for a program that does not take them; the oldest go."""


class VehicleError(RuntimeError):
    """It did not become so. One line: why, and what to do."""


class SilentError(VehicleError):
    """Nothing was heard from the vehicle in time."""


class NotReadyError(VehicleError):
    """The vehicle says what it lacks."""


class RefusedError(VehicleError):
    """The vehicle, or this ground before it was asked, said no."""


class Vehicle:
    """A vehicle for as long as the ``async with`` lasts. Its methods are for one event loop."""

    def __init__(self, link: GroundLink) -> None:
        """``link`` is closed with it. Programs call ``connect``."""
        self.link = link
        """What is below: every method of it may be called from any thread."""

    @classmethod
    def connect(cls, name: str = DEFAULT_VEHICLE, *, at: str = DEFAULT_CONNECT, identity: Path | None = None) -> Self:
        """Begins to dial and returns at once. ``at``: its endpoint; ``identity``: the folder of who you are, for tls.

        Raises VehicleError if name, endpoint or identity cannot be one.
        """
        try:
            return cls(GroundLink(vehicle=name, connect=at, identity=identity))
        except LinkError as error:
            raise VehicleError(str(error)) from error

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, kind: type[BaseException] | None, *_: object) -> None:
        stop = self.link.snapshot().stop
        why = "" if stop is None or stop.lapsed else self.link.why_undelivered()
        await asyncio.to_thread(self.link.close)
        if why and kind is None:
            raise SilentError(why)

    @property
    def now(self) -> Snapshot:
        """All that is known at this moment; what is absent was not heard yet."""
        return self.link.snapshot()

    async def until(self, condition: Callable[[Snapshot], bool], timeout_s: float) -> Snapshot:
        """The first snapshot for which a condition holds. Raises SilentError if none did in time."""
        try:
            async with asyncio.timeout(timeout_s):
                while not condition(snap := self.now):
                    await asyncio.sleep(POLL_S)
                return snap
        except TimeoutError:
            raise SilentError(self.link.why_silent(timeout_s)) from None

    async def ready(self, timeout_s: float = 30.0) -> HealthView:
        """Waits until the vehicle may start. Raises NotReadyError with what it lacks, SilentError if it is silent."""
        try:
            snap = await self.until(lambda s: s.health is not None and s.health.ready, timeout_s)
        except SilentError:
            health = self.now.health
            if health is None:
                raise
            missing = "; ".join(f"{check.name}: {check.reason}" for check in health.checks if not check.ok)
            raise NotReadyError(f"{self.link.vehicle} is not ready: {missing or 'it does not say why'}") from None
        assert snap.health is not None  # what was waited for
        return snap.health

    async def watch(self, hz: float = 10.0) -> AsyncIterator[Snapshot]:
        """What is known, so many times a second, heard or not: ``Snapshot.fresh`` tells. Ends with its loop."""
        while True:
            yield self.now
            await asyncio.sleep(1.0 / hz)

    async def events(self) -> AsyncIterator[EventView]:
        """What the vehicle tells of itself from now on, one after the other."""
        loop, waiting = asyncio.get_running_loop(), asyncio.Queue[EventView](EVENTS)

        def take(view: EventView) -> None:
            if waiting.full():
                waiting.get_nowait()
            waiting.put_nowait(view)

        def told(channel: str, view: object) -> None:
            if channel == "event" and isinstance(view, EventView):
                loop.call_soon_threadsafe(take, view)

        end = self.link.listen(told)
        try:
            while True:
                yield await waiting.get()
        finally:
            end()

    async def start(self, profile: str = "", *, timeout_s: float = 5.0) -> CommandView:
        """Asks for the flight to begin; ``profile`` empty: the vehicle's default. Returns its answer.

        Cancelled, it asks no more; the vehicle may have heard it before. Raises RefusedError with the reason,
        SilentError if no answer came.
        """
        given_up = threading.Event()
        try:
            start = asyncio.to_thread(self.link.start, profile, timeout_s=timeout_s, given_up=given_up)
            return _granted(await start)
        finally:
            given_up.set()

    async def stop(self, *, timeout_s: float | None = None) -> CommandView:
        """Asks for the flight to end until the vehicle confirms it, however long that takes. Returns its answer.

        With ``timeout_s`` it gives up then. Cancelled, it goes on asking until the ``async with`` ends. Raises
        RefusedError, SilentError: then the pilot must take over.
        """
        pressed = self.link.press_stop()
        loop = asyncio.get_running_loop()
        deadline = None if timeout_s is None else loop.time() + timeout_s
        while not self.link.stop_ended(0.0):
            if deadline is not None and loop.time() >= deadline:
                self.link.give_up_stop()
            await asyncio.sleep(POLL_S)
        return _granted(self.link.stop_outcome or pressed)

    async def record(self, path: Path | str, *, seconds: float | None = None) -> int:
        """Writes what is heard into a new log, for `goshawk review` and `report`; how many messages it holds.

        Without ``seconds`` until it is cancelled, which leaves a whole file. Raises OSError if it cannot be written.
        """
        ended = threading.Event()
        task = asyncio.create_task(asyncio.to_thread(record, self.link, Path(path), ended.is_set))
        try:
            await asyncio.wait({task}, timeout=seconds)
        finally:
            ended.set()
            written = await task
        return written


def _granted(view: CommandView) -> CommandView:
    if view.refused_here or (view.answered and not view.accepted):
        raise RefusedError(f"{view.verb} refused: {view.text}")
    if not view.answered:
        raise SilentError(view.text)
    return view
