"""What a review's desk answers over a real WebSocket: curves, values at the playhead, seeks, alignment."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recordings as rec
from aiohttp import ClientWebSocketResponse, WSMsgType, web
from aiohttp.test_utils import TestClient, TestServer
from goshawk_dashboards.log import align, recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.review.desk import PATH, Desk, Seat, Table
from goshawk_dashboards.review.player import Player

VIEWER = 3
SHOW = {"type": "show", "chart": 0, "number": 1, "from_s": 0.0, "to_s": 8.0, "columns": 400}


class Visit:
    """A browser's end, and the seat that it moves."""

    def __init__(self, socket: ClientWebSocketResponse, seat: Seat) -> None:
        self.socket, self.seat = socket, seat

    async def say(self, **message: Any) -> None:
        """Sends a message."""
        await self.socket.send_str(json.dumps(message))

    async def hear(self, kind: str, when: Callable[[dict[str, Any]], bool] = lambda _: True) -> dict[str, Any]:
        """The next message of a kind that fits."""
        async with asyncio.timeout(20.0):
            while True:
                message = json.loads(await self.socket.receive_bytes())
                if message["type"] == kind and when(message):
                    return message

    async def closed(self) -> bool:
        """Whether the desk has hung up."""
        async with asyncio.timeout(20.0):
            while (await self.socket.receive()).type not in (WSMsgType.CLOSE, WSMsgType.CLOSED):
                pass
        return True


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A flight of 8 s and one of 6 s."""
    folder = tmp_path_factory.mktemp("desk")
    return [rec.write_flight(folder / "long.mcap", 8.0), rec.write_flight(folder / "short.mcap", 6.0)]


def at_the_desk(logs: list[Path], acts: Callable[[Visit], Awaitable[None]]) -> None:
    """Opens a desk of these logs, and lets a visitor act."""
    flights = [Flight.open(log) for log in logs]
    table = Table(
        flights=tuple(flights),
        replay=None,
        marks=recorded.marks_of(flights[0]),
        stops_s=recorded.stops_s(flights[0]),
        alignments=align.common(flights),
    )
    by_s = table.alignments[align.START]
    seat = Seat(player=Player(table.axis_s(by_s)[1]), aligned=align.START, by_s=by_s)
    desk = Desk(table, lambda client: seat if client == VIEWER else None)

    async def answer(request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        await desk.talk(socket)
        return socket

    async def run() -> None:
        app = web.Application()
        app.router.add_get(PATH, answer)
        async with TestClient(TestServer(app)) as client, client.ws_connect(PATH) as socket:
            await acts(Visit(socket, seat))

    asyncio.run(run())


def test_a_browser_hears_of_the_flight_and_gets_curves_and_the_values_at_its_playhead(logs: list[Path]) -> None:
    async def acts(visit: Visit) -> None:
        await visit.say(type="hello", viewer=VIEWER)
        about = await visit.hear("about")
        assert [p["name"] for p in about["phases"]][:2] == ["take-off", "tracking"]
        assert about["units"]["control.vel_world.x"] == "m/s" and about["charts"][0] == ["speed", "target speed"]
        (north,) = [chart for chart in about["charts"] if "measured acceleration north" in chart]
        assert {"desired acceleration north", "commanded acceleration north"} < set(north)
        await visit.say(**SHOW, signals=["speed", "plan.candidates.7.cost"])
        curves = await visit.hear("curves")
        speed, cost = curves["lines"]
        assert (speed["key"], speed["unit"], cost["key"]) == ("0/speed", "m/s", "0/plan.candidates.7.cost")
        assert len(speed["t"]) == len(speed["v"]) <= 2 * 400 + 2
        assert set(cost["v"]) == {1.0}
        await visit.say(type="seek", time_s=2.0)
        now = await visit.hear("now", lambda message: message["time_s"] == 2.0)
        assert now["values"]["0/speed"] == pytest.approx(np.hypot(4.0, 2.0 * np.cos(2.0)), abs=1e-6)
        assert now["values"]["0/plan.candidates.7.cost"] == 1.0

    at_the_desk(logs[:1], acts)


def test_a_value_follows_though_nothing_moves(logs: list[Path]) -> None:
    async def acts(visit: Visit) -> None:
        await visit.say(type="hello", viewer=VIEWER)
        await visit.say(type="seek", time_s=2.0)
        await visit.hear("now", lambda message: message["time_s"] == 2.0)
        await visit.say(**SHOW, signals=["target.since_seen_s"])
        now = await visit.hear("now", lambda message: message["values"].get("0/target.since_seen_s") is not None)
        assert now["values"]["0/target.since_seen_s"] == 0.0

    at_the_desk(logs[:1], acts)


def test_steps_and_play_move_the_seat(logs: list[Path]) -> None:
    async def acts(visit: Visit) -> None:
        await visit.say(type="hello", viewer=VIEWER)
        await visit.say(type="step", what="event", way=1)
        now = await visit.hear("now", lambda message: message["time_s"] > 0.0)
        assert now["time_s"] == pytest.approx(rec.TAKEOFF_S, abs=0.02)
        await visit.say(type="toggle")
        assert (await visit.hear("now", lambda message: message["playing"]))["playing"]

    at_the_desk(logs[:1], acts)


def test_two_flights_are_laid_over_each_other_by_their_landings(logs: list[Path]) -> None:
    async def acts(visit: Visit) -> None:
        await visit.say(type="hello", viewer=VIEWER)
        about = await visit.hear("about")
        assert [f["short"] for f in about["flights"]] == ["long", "short"]
        assert "landing" in about["alignments"]
        await visit.say(type="align", to="landing")
        about = await visit.hear("about")
        assert [f["by_s"] for f in about["flights"]] == [0.0, pytest.approx(2.0)]
        await visit.say(**SHOW, signals=["speed"])
        first, second = (await visit.hear("curves"))["lines"]
        assert first["color"] != second["color"]
        assert second["t"][0] == pytest.approx(2.0)

    at_the_desk(logs, acts)


def test_the_axis_begins_where_the_first_of_the_flights_does(logs: list[Path]) -> None:
    async def acts(visit: Visit) -> None:
        await visit.say(type="hello", viewer=VIEWER)
        about = await visit.hear("about")
        assert (about["begin_s"], about["end_s"]) == (0.0, pytest.approx(8.0, abs=0.02))
        await visit.say(type="align", to="landing")
        about = await visit.hear("about")
        assert [f["by_s"] for f in about["flights"]] == [0.0, pytest.approx(-2.0)]
        assert (about["begin_s"], about["end_s"]) == (pytest.approx(-2.0), pytest.approx(6.0, abs=0.02))
        await visit.say(type="show", chart=0, number=1, signals=["speed"], from_s=-2.0, to_s=6.0, columns=400)
        await visit.say(type="seek", time_s=-1.5)
        values = (await visit.hear("now", lambda message: message["time_s"] == -1.5 and message["values"]))["values"]
        assert values["0/speed"] is None
        assert values["1/speed"] == pytest.approx(np.hypot(4.0, 2.0 * np.cos(0.5)), abs=1e-6)
        await visit.say(type="align", to="start of the log")
        assert (await visit.hear("now", lambda message: message["time_s"] > -1.5))["time_s"] == 0.0

    at_the_desk(logs[::-1], acts)


@pytest.mark.parametrize("words", ['{"type": "rm"}', "no JSON", '{"type": "seek", "time_s": "soon"}'])
def test_what_nobody_may_say_ends_the_visit(logs: list[Path], words: str) -> None:
    async def acts(visit: Visit) -> None:
        await visit.socket.send_str(words)
        assert await visit.closed()

    at_the_desk(logs[:1], acts)


def test_who_has_no_seat_yet_is_told_so(logs: list[Path]) -> None:
    async def acts(visit: Visit) -> None:
        await visit.say(type="hello", viewer=99)
        assert (await visit.hear("stranger")) == {"type": "stranger"}
        await visit.say(type="seek", time_s=2.0)
        assert (await visit.hear("stranger")) == {"type": "stranger"}
        assert visit.seat.player.time_s == 0.0

    at_the_desk(logs[:1], acts)
