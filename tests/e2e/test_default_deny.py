"""Without an identity the vehicle listens to its own host alone, unless its file says `insecure`: then it says so."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from goshawk_ground.link import GroundLink
from goshawk_ground.link.dial import client_config
from people import everybody
from rig import BIN, Rig
from test_bad_input import air, edited
from test_strangers import image, key

HOST = "10.213.7.1"
GUEST = "10.213.7.2"


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.0.2.77:7447"])
def test_a_listener_that_others_reach_is_refused(endpoint: str) -> None:
    line = air("--config", BIN.parents[1] / "air/vehicles/sim.toml", "--listen", endpoint)
    assert endpoint in line
    assert "goshawk keys" in line


def test_tls_without_an_identity_is_refused() -> None:
    line = air("--config", BIN.parents[1] / "air/vehicles/sim.toml", "--listen", "tls/127.0.0.1:7447")
    assert "network.identity" in line


def test_plain_tcp_beside_an_identity_is_refused(tmp_path: Path) -> None:
    people = everybody(tmp_path)
    vehicle = BIN.parents[1] / "air/vehicles/sim.toml"
    line = air("--config", vehicle, "--listen", "tcp/127.0.0.1:7447", "--identity", people.of("vehicle.goshawk"))
    assert "tcp/127.0.0.1:7447" in line


@pytest.mark.parametrize(
    ("whose", "words"),
    [("vehicle.other", "vehicle.other"), ("nobody", "key.pem"), ("operator.carol", "operator.carol")],
)
def test_an_identity_that_is_not_the_vehicles_is_refused(tmp_path: Path, whose: str, words: str) -> None:
    people = everybody(tmp_path)
    vehicle = BIN.parents[1] / "air/vehicles/sim.toml"
    line = air("--config", vehicle, "--listen", "tls/127.0.0.1:0", "--identity", people.of(whose))
    assert words in line


def run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


@pytest.fixture
def guest() -> Iterator[list[str]]:
    """A second host beside this one, in a network namespace: what to put before a command to run it there."""
    name, here, there = f"goshawk-{os.getpid()}", f"gh{os.getpid() % 100000}", f"gt{os.getpid() % 100000}"
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip("needs root and the command `ip`, for a network namespace")
    run("ip", "netns", "add", name)
    try:
        run("ip", "link", "add", here, "type", "veth", "peer", "name", there, "netns", name)
        run("ip", "addr", "add", f"{HOST}/24", "dev", here)
        run("ip", "link", "set", here, "up")
        run("ip", "-n", name, "addr", "add", f"{GUEST}/24", "dev", there)
        run("ip", "-n", name, "link", "set", there, "up")
        yield ["ip", "netns", "exec", name]
    finally:
        run("ip", "netns", "del", name)


INTRUDER = """
import sys, time
import zenoh
from goshawk_ground.link.dial import client_config
from goshawk_proto import goshawk_pb2
sys.path.insert(0, sys.argv[2])
from test_strangers import image, key
with zenoh.open(client_config(sys.argv[1])) as session:
    for _ in range(60):
        session.put(key("rgbd"), image())
        time.sleep(0.02)
    replies = list(session.get(key("ping"), timeout=2.0))
    print("pinged" if any(reply.ok is not None for reply in replies) else "silent")
"""


def test_an_insecure_vehicle_says_so_and_takes_no_picture_from_another_host(
    rig: Rig, tmp_path: Path, guest: list[str]
) -> None:
    vehicle = edited(tmp_path, 'listen = ["tcp/127.0.0.1:7447"]', 'insecure = true\nlisten = ["tcp/127.0.0.1:7447"]')
    endpoint = f"tcp/0.0.0.0:{rig.zenoh_port}"
    rig.spawn(
        "air", BIN / "goshawk-air", "run", "--config", vehicle, "--listen", endpoint,
        "--mavlink-bind", f"127.0.0.1:{rig.mavlink_port}", "--log-dir", rig.logs,
    )  # fmt: skip
    with GroundLink(connect=rig.endpoint) as link:
        snap = link.wait_for(lambda s: s.health is not None, 20.0)
        assert snap is not None and snap.health is not None, rig.output("air")
        assert any("INSECURE" in fault for fault in snap.health.faults)
        assert "INSECURE" in rig.output("air")
        # This host's own pictures are taken, as far as they are pictures.
        with zenoh.open(client_config(rig.endpoint)) as own:
            deadline = time.monotonic() + 10.0
            while link.snapshot().preview is None and time.monotonic() < deadline:
                own.put(key("rgbd"), image())
                time.sleep(0.02)
        assert (first := link.snapshot().preview) is not None
        time.sleep(1.0)
        done = subprocess.run(
            [*guest, sys.executable, "-c", INTRUDER, f"tcp/{HOST}:{rig.zenoh_port}", str(Path(__file__).parent)],
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert done.stdout.strip() == "pinged", done.stderr
        newest = link.snapshot().preview
        assert newest is not None and newest.seq <= first.seq + 1
    assert "may not put" in rig.output("air")
