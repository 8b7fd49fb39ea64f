"""What the script in a browser is answered: flights, curves of the signals it shows, where its timeline stands.

A browser opens one WebSocket beside viser's and names its viser client, whose player it moves. All is JSON: a tagged
object a message. The logs are read here by handles of their own, so that a slow signal never stops the scene.
"""

from __future__ import annotations

import asyncio
import itertools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from aiohttp import WSMsgType, web
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.charts import beside
from goshawk_dashboards.charts.beside import Beside
from goshawk_dashboards.charts.curves import drawn
from goshawk_dashboards.charts.signals import CHARTS, REPLAYED, Signals, looks_of, unit_of
from goshawk_dashboards.log.flight import Flight, LogError
from goshawk_dashboards.log.recorded import Mark
from goshawk_dashboards.page import theme
from goshawk_dashboards.review import altering
from goshawk_dashboards.review.altering import MARK, Alteration, Altered, AlterError, Replanner
from goshawk_dashboards.review.player import SPEEDS, Player
from goshawk_dashboards.review.scene import color_of
from goshawk_dashboards.review.timeline import MARK_COLORS, phase_rgb
from goshawk_dashboards.state.snapshot import SAMPLE_STALE_S
from goshawk_dashboards.state.views import Array

PATH = "/charts"
TOLD_HZ = 20.0
MOST_COLUMNS = 4000
MOST_SIGNALS = 64


class Hello(msgspec.Struct, tag="hello", forbid_unknown_fields=True):
    """Which viser client this browser is."""

    viewer: int


class Seek(msgspec.Struct, tag="seek", forbid_unknown_fields=True):
    """Go to a time; ``hand``: a hand holds the timeline and may move on."""

    time_s: float
    hand: bool = False


class Toggle(msgspec.Struct, tag="toggle", forbid_unknown_fields=True):
    """Play or pause."""


class Step(msgspec.Struct, tag="step", forbid_unknown_fields=True):
    """One frame or event on or back."""

    what: Literal["frame", "event"]
    way: Literal[-1, 1]


class Speed(msgspec.Struct, tag="speed", forbid_unknown_fields=True):
    """Recorded seconds in each second."""

    times: float


class Align(msgspec.Struct, tag="align", forbid_unknown_fields=True):
    """The moment by which the flights are laid over each other."""

    to: str


class Show(msgspec.Struct, tag="show", forbid_unknown_fields=True):
    """The curves of a chart within a window of time."""

    chart: int
    number: int
    signals: list[str]
    from_s: float
    to_s: float
    columns: int


class Alter(msgspec.Struct, tag="alter", forbid_unknown_fields=True):
    """Plan again from the shown instant on, with another policy or other parameters."""

    for_s: float
    changes: list[str]
    policy: str | None = None


class Restore(msgspec.Struct, tag="restore", forbid_unknown_fields=True):
    """Show the flight as it was again."""


Request = Hello | Seek | Toggle | Step | Speed | Align | Show | Restore
"""What is answered at once."""
_decode = msgspec.json.Decoder(Request | Alter).decode


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """What all browsers see of the flights."""

    flights: tuple[Flight, ...]
    """The logs by handles of their own."""
    replay: Flight | None
    marks: tuple[Mark, ...]
    stops_s: Array
    alignments: dict[str, tuple[float, ...]]
    replanner: Replanner | None = None
    """Plans the first flight again; None: there is no program for it."""
    beside: Beside | None = None
    """Another log of the first flight."""

    def axis_s(self, by_s: Sequence[float]) -> tuple[float, float]:
        """From where the first of the flights begins to where the last ends, by the reviewed flight's own seconds."""
        return min(by_s), max(f.duration_s + by for f, by in zip(self.flights, by_s, strict=True))


@dataclass(kw_only=True, eq=False)
class Seat:
    """One viewer: the player and how the flights are aligned."""

    player: Player
    aligned: str
    by_s: tuple[float, ...]
    """How much later each flight is shown."""
    altered: Altered | None = None


@dataclass(kw_only=True, eq=False)
class _Visit:
    """A WebSocket: whose, and what it shows."""

    viewer: int | None = None
    signals: dict[int, list[str]] = field(default_factory=dict[int, list[str]])
    answers: int = 0
    told: tuple[float, bool, int] | None = None
    """Time, whether it played, and how many charts had been answered, when it was told last."""


class Desk:
    """Talks with every browser of a review, each about its own seat."""

    def __init__(self, table: Table, seat_of: Callable[[int], Seat | None], folder: Path | None = None) -> None:
        """``seat_of`` finds the seat of a viser client; what is altered passes through files in ``folder``."""
        self._table, self._seat_of, self._folder = table, seat_of, folder
        self._alterations = itertools.count()
        replayed = None if table.replay is None else {REPLAYED: table.replay.chosen_cost}
        self._signals = [Signals(table.flights[0], replayed), *(Signals(flight) for flight in table.flights[1:])]
        self._reading = threading.Lock()
        self._event_stops_s = np.unique([m.time_s for m in table.marks])

    async def talk(self, browser: web.WebSocketResponse) -> None:
        """Until the browser leaves or says what nobody may."""
        visit = _Visit()
        telling = asyncio.create_task(self._tell(browser, visit))
        replanning: asyncio.Task[None] | None = None
        try:
            async for message in browser:
                if message.type is not WSMsgType.TEXT:
                    return
                try:
                    request = _decode(message.data)
                except msgspec.MsgspecError:
                    return
                if isinstance(request, Alter):
                    # It takes seconds, in which the timeline goes on.
                    if replanning is None or replanning.done():
                        replanning = asyncio.create_task(self._alter(browser, visit, request))
                    continue
                reply = await self._answer(visit, request)
                if reply is not None:
                    await browser.send_bytes(msgspec.json.encode(reply))
        finally:
            telling.cancel()
            if replanning is not None:
                replanning.cancel()

    async def _tell(self, browser: web.WebSocketResponse, visit: _Visit) -> None:
        """Where the timeline stands, whenever that has changed."""
        while True:
            await asyncio.sleep(1.0 / TOLD_HZ)
            seat = None if visit.viewer is None else self._seat_of(visit.viewer)
            if seat is None:
                continue
            now = (seat.player.time_s, seat.player.playing, visit.answers)
            if now != visit.told:
                visit.told = now
                await browser.send_bytes(msgspec.json.encode(self._now(seat, visit)))

    def _now(self, seat: Seat, visit: _Visit) -> dict[str, Any]:
        time_s = seat.player.time_s
        shown = {name for signals in visit.signals.values() for name in signals}
        values = {
            f"{k}/{name}": found.at(known_as, time_s - by_s)
            for k, by_s in enumerate(seat.by_s)
            for name in shown
            if (source := self._source(seat, k, name)) is not None
            for found, known_as in (source,)
        }
        return {"type": "now", "time_s": time_s, "playing": seat.player.playing, "values": values}

    async def _answer(self, visit: _Visit, request: Request) -> dict[str, Any] | None:
        if isinstance(request, Hello):
            visit.viewer = request.viewer
        seat = None if visit.viewer is None else self._seat_of(visit.viewer)
        if seat is None:
            return {"type": "stranger"}
        match request:
            case Hello():
                return await asyncio.to_thread(self._about, seat)
            case Seek(time_s=time_s, hand=hand):
                (seat.player.scrub if hand else seat.player.seek)(time_s)
            case Toggle():
                seat.player.toggle()
            case Step(what=what, way=way):
                seat.player.step(self._event_stops_s if what == "event" else self._table.stops_s, way)
            case Speed(times=times):
                if times in SPEEDS:
                    seat.player.set_speed(times)
            case Align(to=to):
                if to in self._table.alignments:
                    self.align(seat, to)
                    return await asyncio.to_thread(self._about, seat)
            case Restore():
                seat.altered = None
                seat.player.touch()
                return await asyncio.to_thread(self._about, seat)
            case Show():
                visit.signals[request.chart] = request.signals[:MOST_SIGNALS]
                reply = await asyncio.to_thread(self._curves, seat, request)
                visit.answers += 1
                return reply
        return None

    async def _alter(self, browser: web.WebSocketResponse, visit: _Visit, request: Alter) -> None:
        """Says what came of an alteration in a line, and what the charts can show of it."""
        seat = None if visit.viewer is None else self._seat_of(visit.viewer)
        if seat is None:
            return
        replies: list[dict[str, Any]] = []
        try:
            altered = await asyncio.to_thread(self._altered, seat.player.time_s - seat.by_s[0], request)
        except (AlterError, LogError) as error:
            replies.append({"type": "altered", "error": str(error)})
        else:
            seat.altered = altered
            seat.player.seek(altered.at_s + seat.by_s[0])
            replies.append(await asyncio.to_thread(self._about, seat))
            charts = [[name, MARK + name] for name in altering.CHARTS]
            at_s, to_s = altered.at_s + seat.by_s[0], altered.to_s + seat.by_s[0]
            replies.append({"type": "altered", "words": altered.words, "at_s": at_s, "to_s": to_s, "charts": charts})
        for reply in replies:
            await browser.send_bytes(msgspec.json.encode(reply))

    def _altered(self, time_s: float, request: Alter) -> Altered:
        if self._table.replanner is None or self._folder is None:
            raise AlterError("nothing plans again here: goshawk-air is not where --bin-dir says")
        flight = self._table.flights[0]
        with self._reading:
            index = flight.index_at("plan", time_s)
            shown_s = time_s if index is None else flight.time_s("plan", index)
        # The plan that is shown, unless it is an old one.
        from_s = max(shown_s if time_s - shown_s < SAMPLE_STALE_S else time_s, 0.0)
        asked = Alteration(from_s=from_s, for_s=request.for_s, changes=tuple(request.changes), policy=request.policy)
        out = self._folder / f"altered-{next(self._alterations)}.mcap"
        return Altered.of(self._table.replanner, flight, asked, out)

    def align(self, seat: Seat, to: str) -> None:
        """Lays the flights over each other at a moment that they have in common."""
        seat.aligned, seat.by_s = to, self._table.alignments[to]
        player = seat.player
        player.begin_s, player.end_s = self._table.axis_s(seat.by_s)
        player.seek(player.time_s)  # it may stand where there is nothing any more

    def _source(self, seat: Seat, flight: int, name: str) -> tuple[Signals | Beside, str] | None:
        """Where a flight's signal is read, and its name there; None: that flight has no such one."""
        extras = {MARK: seat.altered and seat.altered.signals, beside.MARK: self._table.beside}
        for mark, signals in extras.items():
            if name.startswith(mark):
                return (signals, name.removeprefix(mark)) if signals is not None and flight == 0 else None
        return self._signals[flight], name

    def _about(self, seat: Seat) -> dict[str, Any]:
        flight = self._table.flights[0]
        with self._reading:
            names = list(dict.fromkeys(name for signals in self._signals for name in signals.names))
            if seat.altered is not None:
                names += [MARK + name for name in seat.altered.signals.names]
            if self._table.beside is not None:
                names += [beside.MARK + name for name in self._table.beside.names]
            phases, fallbacks = flight.phases, flight.fallbacks
        several = len(self._table.flights) > 1
        true = flight.count("sim_truth") > 0
        charts = [
            [s for s in chart.signals[: chart.compared if several else None] if s in names and not (true and s == SLOW)]
            for chart in CHARTS
        ]
        if self._table.beside is not None:
            charts = [["speed", f"{beside.MARK}speed"], ["tilt", f"{beside.MARK}tilt"], *charts[1:]]
        short = short_names([f.path.stem for f in self._table.flights])
        return {
            "type": "about",
            "begin_s": seat.player.begin_s,
            "end_s": seat.player.end_s,
            "speeds": SPEEDS,
            "flights": [
                {"name": f.path.name, "short": short[k], "color": theme.css(color_of(k)), "by_s": by_s}
                for k, (f, by_s) in enumerate(zip(self._table.flights, seat.by_s, strict=True))
            ],
            "alignments": list(self._table.alignments) if several else [],
            "aligned": seat.aligned,
            "phases": [
                {"name": p.name, "from_s": p.start_s, "to_s": p.end_s, "color": theme.css(phase_rgb(p.name))}
                for p in phases
            ],
            "fallbacks": [{"name": p.name, "from_s": p.start_s, "to_s": p.end_s} for p in fallbacks],
            "marks": [
                {
                    "time_s": m.time_s,
                    "text": m.text,
                    "color": theme.css(MARK_COLORS.get(m.severity, theme.TRUTH)),
                    "tall": m.severity != pb.SEVERITY_INFO,
                }
                for m in self._table.marks
            ],
            "charts": [signals for signals in charts if signals],
            "units": {name: unit_of(name.removeprefix(MARK).removeprefix(beside.MARK)) for name in names},
            "alter": self._alterable(),
            "altered": seat.altered is not None,
            "beside": self._lies_beside(),
        }

    def _lies_beside(self) -> dict[str, str] | None:
        """How the other log lies, where there is one."""
        other = self._table.beside
        if other is None:
            return None
        return {"name": other.path.name, "words": other.words, "color": theme.css(theme.SECOND)}

    def _alterable(self) -> dict[str, Any] | None:
        """What may be altered; None: there is no program that plans again."""
        if self._table.replanner is None:
            return None
        flown = altering.parameters(self._table.flights[0].header.tuning_toml)
        return {"policies": self._table.replanner.policies, "parameters": flown}

    def _curves(self, seat: Seat, request: Show) -> dict[str, Any]:
        columns = min(max(request.columns, 50), MOST_COLUMNS)
        lines: list[dict[str, Any]] = []
        several = len(self._table.flights) > 1
        wanted = list(dict.fromkeys(request.signals[:MOST_SIGNALS]))
        for k, by_s in enumerate(seat.by_s):
            for place, name in enumerate(wanted):
                source = self._source(seat, k, name)
                if source is None:
                    continue
                signals, known_as = source
                with self._reading:
                    ((times_s, values),) = signals.read([known_as]).values()
                rgb, dashed = looks_of(name, place)
                if known_as != name:
                    rgb, dashed = theme.REPLAY if name.startswith(MARK) else theme.SECOND, False
                if several:
                    rgb, dashed = color_of(k), place > 0
                t, v = drawn(times_s, values, request.from_s - by_s, request.to_s - by_s, columns)
                lines.append(
                    {
                        "key": f"{k}/{name}",
                        "label": name,
                        "flight": k,
                        "unit": unit_of(known_as),
                        "color": theme.css(rgb),
                        "dashed": dashed,
                        "t": np.round(t + by_s, 6).tolist(),
                        "v": [None if np.isnan(x) else x for x in v.tolist()],
                    }
                )
        return {"type": "curves", "chart": request.chart, "number": request.number, "lines": lines}


SLOW = "clearance by depth"
"""It takes a second for ten of flight, so it waits to be asked for where the simulator tells the true one."""


def short_names(names: Sequence[str]) -> list[str]:
    """Names without the words that all of them begin with."""
    parts = [name.split("-") for name in names]
    same = 0
    while len(names) > 1 and all(len(p) > same + 1 and p[same] == parts[0][same] for p in parts):
        same += 1
    return ["-".join(p[same:]) for p in parts]
