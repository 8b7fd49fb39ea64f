"""Stop is latched: over cuts of the link and restarts of ground and vehicle it is delivered, and acted on once."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from goshawk_dashboards.state.views import CommandView
from goshawk_ground.commands.pages import say_if_pending
from goshawk_ground.link import GroundLink
from goshawk_ground.orders.stop_file import PendingStop, StopFile
from goshawk_ground.orders.stop_latch import RESUME_S, THREADS, StopLatch
from goshawk_ground.pages.ports import free_port
from goshawk_proto import goshawk_pb2 as pb
from relay import Relay

Fakes = Callable[..., Any]
CUT_S = 8.0


def stops_of(acted: Path) -> list[str]:
    """The ids of the stops that the vehicle acted on."""
    lines = acted.read_text().splitlines() if acted.exists() else []
    return [line.split()[1] for line in lines if line.startswith("stop ")]


def flying(link: GroundLink) -> None:
    assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
    assert link.start().accepted
    assert link.wait_for(lambda s: s.mode == pb.MODE_TRACK, 20)


@pytest.fixture
def relay_to() -> Iterator[Callable[[str], Relay]]:
    """Makes relays."""
    made: list[Relay] = []

    def make(endpoint: str) -> Relay:
        made.append(Relay(endpoint))
        return made[-1]

    yield make
    for relay in made:
        relay.close()


@pytest.mark.parametrize("how", ["cut", "stall"])
def test_a_stop_pressed_while_the_link_is_down_is_delivered_after_it(
    fake_vehicle: Fakes, relay_to: Callable[[str], Relay], tmp_path: Path, how: str
) -> None:
    acted = tmp_path / "acted"
    relay = relay_to(fake_vehicle("--acted", str(acted)).endpoint)
    with GroundLink(connect=relay.endpoint, state=tmp_path) as link:
        flying(link)
        (relay.cut if how == "cut" else relay.stall)()
        link.press_stop()
        down_s = time.monotonic()
        assert not link.stop_ended(CUT_S)
        assert time.monotonic() - down_s >= CUT_S - 0.1
        snap = link.snapshot()
        assert snap.stop is not None
        assert snap.stop.age_s > 7.0
        assert stops_of(acted) == []
        relay.mend()
        assert link.stop_ended(20.0)
        command = link.snapshot().command
        assert command is not None
        assert (command.verb, command.accepted) == ("stop", True)
        assert stops_of(acted) == [command.command_id]
        assert link.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 10)
    assert list(tmp_path.glob("stop-*")) == []


def test_pressing_again_keeps_the_id_and_a_start_waits_for_it(
    fake_vehicle: Fakes, relay_to: Callable[[str], Relay], tmp_path: Path
) -> None:
    acted = tmp_path / "acted"
    relay = relay_to(fake_vehicle("--acted", str(acted)).endpoint)
    with GroundLink(connect=relay.endpoint) as link:
        flying(link)
        relay.cut()
        first = link.press_stop().command_id
        assert [link.press_stop().command_id for _ in range(5)] == [first] * 5
        refused = link.start(timeout_s=0.5)
        assert refused.refused_here
        assert "a Stop is not confirmed yet" in refused.text
        relay.mend()
        assert link.stop_ended(20.0)
        assert stops_of(acted) == [first]
        assert link.snapshot().command is not None


def test_a_start_that_was_lost_is_not_asked_again_after_a_stop(
    fake_vehicle: Fakes, relay_to: Callable[[str], Relay], tmp_path: Path
) -> None:
    acted, began = tmp_path / "acted", list[CommandView]()
    relay = relay_to(fake_vehicle("--acted", str(acted)).endpoint)
    with GroundLink(connect=relay.endpoint) as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
        relay.cut()
        starting = threading.Thread(target=lambda: began.append(link.start(timeout_s=20)))
        starting.start()
        time.sleep(0.5)
        link.press_stop()
        relay.mend()
        assert link.stop_ended(20.0)
        starting.join()
        assert began[0].refused_here and "a Stop was pressed" in began[0].text
        assert len(stops_of(acted)) == 1 and "start" not in acted.read_text()


def test_a_stop_that_no_thread_can_ask_for_is_not_pending_and_the_next_one_is_sent(
    fake_vehicle: Fakes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_left(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with GroundLink(connect=fake_vehicle().endpoint) as link:
        flying(link)
        with monkeypatch.context() as full:
            full.setattr(threading.Thread, "start", none_left)
            link.press_stop()
        command = link.snapshot().command
        assert command is not None and "press again" in command.text and link.stop_ended(0.0)
        assert link.stop().accepted


def test_a_stop_that_is_cancelled_is_never_delivered(
    fake_vehicle: Fakes, relay_to: Callable[[str], Relay], tmp_path: Path
) -> None:
    acted = tmp_path / "acted"
    relay = relay_to(fake_vehicle("--acted", str(acted)).endpoint)
    with GroundLink(connect=relay.endpoint, state=tmp_path) as link:
        flying(link)
        relay.cut()
        assert link.wait_for(lambda s: not s.linked, 10)
        link.press_stop()
        assert (tmp_path / "stop-goshawk.json").exists()
        link.cancel_stop()
        command = link.snapshot().command
        assert command is not None and command.cancelled
        assert not (tmp_path / "stop-goshawk.json").exists()
        relay.mend()
        assert link.wait_for(lambda s: s.linked and s.fresh("control", 0.5), 20)
        time.sleep(1.0)
        assert link.snapshot().mode == pb.MODE_TRACK
        assert stops_of(acted) == []


def test_a_vehicle_that_restarts_meanwhile_gets_the_same_stop(
    fake_vehicle: Fakes, relay_to: Callable[[str], Relay], tmp_path: Path
) -> None:
    acted = tmp_path / "acted"
    vehicle = fake_vehicle()
    relay = relay_to(vehicle.endpoint)
    with GroundLink(connect=relay.endpoint) as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
        relay.cut()
        assert link.wait_for(lambda s: not s.linked, 10)
        command_id = link.press_stop().command_id
        vehicle.kill()
        fake_vehicle("--acted", str(acted), endpoint=vehicle.endpoint)
        relay.mend()
        assert link.stop_ended(20.0)
        assert stops_of(acted) == [command_id]


@contextmanager
def ground_station(endpoint: str, state: Path) -> Generator[subprocess.Popen[str]]:
    """`goshawk ground` in a process of its own, serving."""
    command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", "ground", "--connect", endpoint]
    environment = os.environ | {"XDG_STATE_HOME": str(state)}
    process = subprocess.Popen(
        [*command, "--port", str(free_port(18900))],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("dashboard:")
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_ground_that_is_killed_and_started_again_delivers_the_stop(
    fake_vehicle: Fakes, relay_to: Callable[[str], Relay], tmp_path: Path
) -> None:
    acted = tmp_path / "acted"
    relay = relay_to(fake_vehicle("--acted", str(acted)).endpoint)
    kept = tmp_path / "goshawk/stop-goshawk.json"
    # Whoever pressed is killed with the Stop pending: no clean-up, no goodbye.
    pressing = (
        "import sys, time; from pathlib import Path; from goshawk_ground.link import GroundLink\n"
        "link = GroundLink(connect=sys.argv[1], state=Path(sys.argv[2]))\n"
        "link.wait_for(lambda s: s.linked, 20); print('linked', flush=True); sys.stdin.readline()\n"
        "link.press_stop(); print('pressed', flush=True); time.sleep(60)\n"
    )
    first = subprocess.Popen(
        [sys.executable, "-c", pressing, relay.endpoint, str(kept.parent)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert first.stdin is not None and first.stdout is not None
    assert first.stdout.readline() == "linked\n"
    relay.cut()
    first.stdin.write("\n")
    first.stdin.flush()
    assert first.stdout.readline() == "pressed\n"
    first.send_signal(signal.SIGKILL)
    first.communicate()
    command_id = json.loads(kept.read_text())["command_id"]
    with ground_station(relay.endpoint, tmp_path):
        time.sleep(1.0)
        assert stops_of(acted) == []
        relay.mend()
        deadline = time.monotonic() + 20.0
        while not stops_of(acted):
            assert time.monotonic() < deadline, "the Stop was not delivered"
            time.sleep(0.05)
        assert stops_of(acted) == [command_id]
        while kept.exists():
            assert time.monotonic() < deadline, "the Stop was not forgotten"
            time.sleep(0.05)


def test_a_ground_that_ends_with_a_stop_pending_says_so(free_endpoint: str, tmp_path: Path) -> None:
    StopFile(tmp_path / "goshawk", "goshawk").save(PendingStop(command_id="x", pressed_unix_s=time.time()))
    with ground_station(free_endpoint, tmp_path) as process:
        process.send_signal(signal.SIGINT)
        _, words = process.communicate(timeout=30)
        assert "goshawk: Stop not delivered. Pilot: take over." in words
    assert (tmp_path / "goshawk/stop-goshawk.json").exists()


@pytest.mark.parametrize("age_s", [RESUME_S + 5.0, -2.0 * RESUME_S])
def test_a_stop_that_is_too_old_is_shown_and_not_sent(fake_vehicle: Fakes, tmp_path: Path, age_s: float) -> None:
    acted = tmp_path / "acted"
    file = StopFile(tmp_path, "goshawk")
    file.save(PendingStop(command_id="old", pressed_unix_s=time.time() - age_s))
    with GroundLink(connect=fake_vehicle("--acted", str(acted)).endpoint, state=tmp_path) as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
        stop = link.snapshot().stop
        assert stop is not None and stop.lapsed
        assert link.start().accepted
        assert stops_of(acted) == []
        link.cancel_stop()
        assert link.snapshot().stop is None
    assert file.load() is None


def test_a_damaged_stop_file_is_no_stop(tmp_path: Path) -> None:
    file = StopFile(tmp_path, "goshawk")
    for text in ("", "{", "[]", '{"command_id": 1}', '{"command_id": "", "pressed_unix_s": 0}', "\x00" * 64):
        file.path.write_text(text)
        assert file.load() is None
    file.save(PendingStop(command_id="one", pressed_unix_s=1.0))
    file.forget("another")
    assert file.load() == PendingStop(command_id="one", pressed_unix_s=1.0)


def test_a_state_folder_that_cannot_be_written_does_not_hinder_a_stop(fake_vehicle: Fakes, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with GroundLink(connect=fake_vehicle().endpoint, state=tmp_path / "file") as link:
        flying(link)
        assert link.stop().accepted


def test_goshawk_stop_says_that_it_is_pending_and_on_interrupt_that_it_was_not_delivered(free_endpoint: str) -> None:
    command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", "stop", "--connect", free_endpoint]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    killer = threading.Timer(60.0, process.kill)
    killer.start()
    first = process.stderr.readline()
    assert first.startswith("goshawk: stop pending for 3 s. Stop not delivered. Pilot: take over.")
    process.send_signal(signal.SIGINT)
    out, words = process.communicate(timeout=30)
    killer.cancel()
    assert (process.returncode, out) == (2, "")
    assert words.splitlines()[-1].startswith("goshawk: Stop not delivered. Pilot: take over. There is no link to tcp/")


def test_goshawk_stop_waits_until_it_is_confirmed(fake_vehicle: Fakes, relay_to: Callable[[str], Relay]) -> None:
    relay = relay_to(fake_vehicle().endpoint)
    relay.cut()
    command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", "stop", "--connect", relay.endpoint]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    assert "stop pending" in process.stderr.readline()
    relay.mend()
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert out.startswith("stop accepted")


class Deaf:
    """A link whose questions are heard, but whose answers never come."""

    linked, closing, stops_pressed, told_stops = True, False, 0, (0, 0)

    def __init__(self) -> None:
        self.heard: list[str] = []

    def ask(self, key: str, request: Any, timeout_s: float) -> Iterator[Any]:
        self.heard.append(request.command_id)
        deadline = time.monotonic() + 4.0
        while time.monotonic() < deadline and not self.closing:
            time.sleep(0.01)
        return iter(())

    def why_silent(self, waited_s: float) -> str:
        return "nobody answers"

    def refuses_start(self, timeout_s: float) -> str:
        return ""


def test_a_new_stop_is_asked_though_the_questions_of_one_before_still_wait() -> None:
    link, told = Deaf(), list[CommandView]()
    latch = StopLatch(link, told.append, None)
    for _ in range(6):
        latch.press()
        time.sleep(0.05)
    assert 1 < len(link.heard) <= THREADS, "who hammers does not get a thread for each blow"
    latch.cancel()
    assert latch.outcome is not None and latch.outcome.cancelled
    pressed = latch.press()
    deadline = time.monotonic() + 2.0
    while pressed.command_id not in link.heard:
        assert time.monotonic() < deadline, "it is pending, and nobody asks"
        time.sleep(0.01)
    link.closing = True
    latch.join(5.0)


@pytest.mark.parametrize("age_s", [0.0, RESUME_S + 60.0])
def test_whoever_ends_the_ground_is_told_what_becomes_of_the_stop(
    age_s: float,
    free_endpoint: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with GroundLink(connect=free_endpoint, state=tmp_path) as link:
        link.press_stop()
        now_s = time.monotonic()
        monkeypatch.setattr(time, "monotonic", lambda: now_s + age_s)
        say_if_pending(link)
        monkeypatch.undo()
    said = capsys.readouterr().err
    assert ("sends it again if it starts within 10 minutes" if age_s == 0.0 else "It is too old") in said


def test_a_stop_that_could_not_be_kept_is_not_promised(
    free_endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    with GroundLink(connect=free_endpoint, state=tmp_path / "file") as link:
        link.press_stop()
        say_if_pending(link)
    said = capsys.readouterr().err
    assert "does not know of it" in said and "sends it again" not in said
