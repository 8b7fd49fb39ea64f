"""`goshawk.Vehicle` as a program meets it, with a real Zenoh vehicle at the other end."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from goshawk import NotReadyError, RefusedError, SilentError, Vehicle, VehicleError
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.state.views import EventView
from goshawk_proto import goshawk_pb2 as pb

Fakes = Callable[..., Any]


def with_vehicle(endpoint: str, program: Callable[[Vehicle], Awaitable[None]]) -> None:
    """Runs a program with the vehicle at an endpoint."""

    async def run() -> None:
        async with Vehicle.connect(at=endpoint) as vehicle:
            await program(vehicle)

    asyncio.run(run())


def test_a_program_flies_from_ready_to_landed_and_keeps_a_log_of_it(fake_vehicle: Fakes, tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    modes: list[int | None] = []

    async def program(vehicle: Vehicle) -> None:
        assert (await vehicle.ready()).ready
        recording = asyncio.create_task(vehicle.record(log))
        assert (await vehicle.start()).text == "taking off"
        async for snap in vehicle.watch(hz=20.0):
            modes.append(snap.mode)
            if snap.mode == pb.MODE_TRACK and snap.plan is not None and snap.target is not None:
                break
        assert (await vehicle.stop()).text == "braking, then landing"
        await vehicle.until(lambda s: s.mode == pb.MODE_LANDED, 10.0)
        recording.cancel()
        with pytest.raises(asyncio.CancelledError):
            await recording

    with_vehicle(fake_vehicle().endpoint, program)
    assert pb.MODE_TAKEOFF in modes
    flight = Flight.open(log)
    assert (flight.completeness, flight.header.vehicle) == ("complete", "goshawk")
    assert [phase.name for phase in flight.phases][-2:] == ["landing", "landed"]
    assert min(flight.count(channel) for channel in ("control", "plan", "target", "health", "event")) > 0


def test_events_come_one_after_the_other(fake_vehicle: Fakes) -> None:
    heard: list[EventView] = []

    async def program(vehicle: Vehicle) -> None:
        await vehicle.ready()
        await vehicle.start()
        async for event in vehicle.events():
            heard.append(event)
            if event.text == "mode: track":
                return

    with_vehicle(fake_vehicle().endpoint, program)
    assert heard[-1].stamp_ns > 0


def test_what_the_vehicle_refuses_or_lacks_is_raised_in_its_words(fake_vehicle: Fakes) -> None:
    async def program(vehicle: Vehicle) -> None:
        with pytest.raises(NotReadyError, match=r"goshawk is not ready: .*odometry"):
            await vehicle.ready(timeout_s=3.0)
        with pytest.raises(RefusedError, match="start refused: not ready"):
            await vehicle.start()

    with_vehicle(fake_vehicle("--not-ready").endpoint, program)


def test_a_silent_vehicle_is_one_line_that_says_what_to_check(free_endpoint: str) -> None:
    async def program(vehicle: Vehicle) -> None:
        for asked in (vehicle.ready(timeout_s=0.3), vehicle.start(timeout_s=0.3)):
            with pytest.raises(SilentError, match=f"no vehicle at {free_endpoint}"):
                await asked

    with_vehicle(free_endpoint, program)


def test_a_stop_before_there_is_a_link_is_asked_until_it_is_confirmed(fake_vehicle: Fakes, free_endpoint: str) -> None:
    async def program(vehicle: Vehicle) -> None:
        stopping = asyncio.create_task(vehicle.stop())
        await asyncio.sleep(0.1)
        assert vehicle.now.stop is not None
        asked = vehicle.now.stop.command_id
        await asyncio.to_thread(fake_vehicle, endpoint=free_endpoint)
        answer = await stopping
        assert (answer.command_id, answer.accepted) == (asked, True)

    with_vehicle(free_endpoint, program)


def test_leaving_with_a_stop_that_is_not_confirmed_calls_the_pilot(free_endpoint: str) -> None:
    async def program(vehicle: Vehicle) -> None:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(vehicle.stop(), 0.1)

    with pytest.raises(SilentError, match=r"Stop not delivered\. Pilot: take over\."):
        with_vehicle(free_endpoint, program)


def test_a_stop_that_is_given_up_calls_the_pilot(free_endpoint: str) -> None:
    async def program(vehicle: Vehicle) -> None:
        with pytest.raises(SilentError, match=r"Stop not delivered\. Pilot: take over\."):
            await vehicle.stop(timeout_s=0.2)

    with_vehicle(free_endpoint, program)


def test_a_wrong_endpoint_and_a_file_that_exists_are_errors_of_their_own(free_endpoint: str, tmp_path: Path) -> None:
    with pytest.raises(VehicleError, match="'nowhere' is not an endpoint"):
        Vehicle.connect(at="nowhere")
    (tmp_path / "flight.mcap").write_text("mine")

    async def program(vehicle: Vehicle) -> None:
        with pytest.raises(FileExistsError):
            await vehicle.record(tmp_path / "flight.mcap", seconds=0.1)

    with_vehicle(free_endpoint, program)
    assert (tmp_path / "flight.mcap").read_text() == "mine"


def test_a_start_that_is_cancelled_is_not_asked_later(fake_vehicle: Fakes, free_endpoint: str, tmp_path: Path) -> None:
    acted = tmp_path / "acted"

    async def program(vehicle: Vehicle) -> None:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(vehicle.start(timeout_s=20.0), 0.3)
        await asyncio.to_thread(fake_vehicle, "--acted", str(acted), endpoint=free_endpoint)
        await vehicle.ready()
        await asyncio.sleep(2.0)
        assert not acted.exists() or "start" not in acted.read_text()
        await vehicle.start()
        assert acted.read_text().count("start") == 1

    with_vehicle(free_endpoint, program)


def test_a_stops_answer_is_the_stops_though_a_start_follows_at_once(fake_vehicle: Fakes) -> None:
    async def program(vehicle: Vehicle) -> None:
        await vehicle.ready()
        stopping = asyncio.create_task(vehicle.stop())

        async def start_again() -> None:
            while (command := vehicle.now.command) is None or not (command.verb == "stop" and command.answered):
                await asyncio.sleep(0.0)
            with contextlib.suppress(VehicleError):
                await vehicle.start(timeout_s=1.0)

        starting = asyncio.create_task(start_again())
        assert (await stopping).verb == "stop"
        await starting

    with_vehicle(fake_vehicle().endpoint, program)
