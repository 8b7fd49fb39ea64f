"""The whole system as an operator meets it: simulator, vehicle and ground station as three processes, and a browser."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from goshawk_ground.link import GroundLink
from goshawk_ground.pages.ports import free_port
from goshawk_proto import goshawk_pb2 as pb
from playwright.sync_api import expect

ROOT = Path(__file__).resolve().parents[2]
BIN = ROOT / "target/release"
UNDER_WAY = (pb.MODE_TAKEOFF, pb.MODE_SEARCH, pb.MODE_TRACK, pb.MODE_HOLD)


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[tuple[GroundLink, str]]:
    """The three processes; an observing link to the vehicle, and the dashboard's address."""
    zenoh, web = free_port(17600), free_port(18600)
    mavlink = free_port(14640, udp=True)
    endpoint = f"tcp/127.0.0.1:{zenoh}"
    commands: dict[str, list[str]] = {
        "air": [
            str(BIN / "goshawk-air"), "run", "--config", str(ROOT / "air/vehicles/sim.toml"), "--listen", endpoint,
            "--mavlink-bind", f"127.0.0.1:{mavlink}", "--log-dir", str(tmp_path),
        ],
        "sim": [
            str(BIN / "goshawk-sim"), "serve", "--seed", "3", "--spacing", "6", "--speed", "2", "--connect", endpoint,
            "--mavlink-port", str(mavlink),
        ],
        "ground": [
            sys.executable, "-c", "from goshawk_ground.cli import main; main()", "ground", "--connect", endpoint,
            "--port", str(web),
        ],
    }  # fmt: skip
    processes: dict[str, subprocess.Popen[bytes]] = {}
    for name, command in commands.items():
        with (tmp_path / f"{name}.out").open("wb") as out:
            # A Stop that another test's ground left pending is not this one's.
            environment = os.environ | {"XDG_STATE_HOME": str(tmp_path)}
            processes[name] = subprocess.Popen(command, stdout=out, stderr=out, start_new_session=True, env=environment)
    link = GroundLink(connect=endpoint)
    ready = link.wait_for(lambda s: s.mode == pb.MODE_READY and s.health is not None and s.health.ready, 90)
    deadline = time.monotonic() + 30
    while b"observers:" not in (tmp_path / "ground.out").read_bytes() and time.monotonic() < deadline:
        time.sleep(0.1)
    words = {name: (tmp_path / f"{name}.out").read_text(errors="replace")[-2000:] for name in commands}
    if ready is not None:
        yield link, re.findall(r"dashboard: (\S+)", (tmp_path / "ground.out").read_text())[0]
    link.close()
    for process in processes.values():
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
    for process in processes.values():
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if ready is None:
        pytest.fail(f"the vehicle was never ready: {words}")


def test_start_in_the_browser_begins_the_flight_and_stop_ends_it(
    flight: tuple[GroundLink, str], visit: Callable[[str], Any], look: Any
) -> None:
    link, url = flight
    page = visit(url).page
    status = page.locator('[data-goshawk="status"]')
    expect(status).to_have_attribute("data-mode", "ready")
    # A busy machine may miss a readiness check for a moment, and the vehicle then rightly refuses: an operator presses
    # again.
    for _ in range(3):
        page.get_by_role("button", name="Start", exact=True).click()
        page.get_by_role("button", name=re.compile("^Start (now|anyway)$")).click()
        # The click may return late on a busy machine, with the take-off over and the target already caught up with.
        if link.wait_for(lambda s: s.mode in UNDER_WAY, 8):
            break
        expect(page.locator('[data-goshawk="command"]')).to_contain_text("start refused")
    assert link.snapshot().mode in UNDER_WAY
    assert link.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.plan is not None, 40)
    expect(status).to_have_attribute("data-mode", "track", timeout=30_000)

    deadline = time.monotonic() + 30
    while look.flown_green(look.picture(page)) < 40:
        assert time.monotonic() < deadline, "the chosen trajectory was never seen"
    plan, before = link.snapshot().plan, look.picture(page)
    time.sleep(1.0)
    later, after = link.snapshot().plan, look.picture(page)
    assert plan is not None
    assert later is not None
    assert len(later.cost_N) == 15
    assert later.seq > plan.seq
    assert float(np.abs(later.end_pos_world_N3 - plan.end_pos_world_N3).max()) > 0.1
    assert look.changed_fraction(before, after) > 0.005, "the picture stood still"

    page.get_by_role("button", name="Stop", exact=True).click()
    assert link.wait_for(lambda s: s.mode == pb.MODE_STOPPING, 10)
    # Landed lasts until the checks pass again, which may be at once.
    assert link.wait_for(lambda s: s.mode in (pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE), 60)
    assert any("Landed" in event.text for event in link.snapshot().events)
    expect(status).to_have_attribute("data-mode", re.compile("landed|ready|idle"))
    truth = link.snapshot().truth
    assert truth is not None
    assert float(np.linalg.norm(truth.vel_world_3)) < 0.3
