"""The operator behind a radio that loses packets: by TLS, from another network namespace."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from goshawk_ground.link import DEFAULT_VEHICLE
from lossy_net import NEAR, LossyNet, missing
from people import People, everybody
from rig import BIN, VEHICLE, Rig


def goshawk(net: LossyNet, people: People, rig: Rig, *words: str) -> subprocess.CompletedProcess[str]:
    command = [
        *net.before, sys.executable, "-c", "from goshawk_ground.cli import main; main()", *words, "--connect",
        f"tls/{NEAR}:{rig.zenoh_port}", "--identity", str(people.of("operator.alice")),
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def ready_vehicle(rig: Rig) -> People:
    people = everybody(rig.folder)
    rig.identity = people.of(f"vehicle.{DEFAULT_VEHICLE}")
    rig.spawn(
        "air", BIN / "goshawk-air", "run", "--config", VEHICLE, "--listen", f"tls/0.0.0.0:{rig.zenoh_port}",
        "--listen", rig.socket, "--identity", rig.identity, "--mavlink-bind", f"127.0.0.1:{rig.mavlink_port}",
        "--log-dir", rig.logs,
    )  # fmt: skip
    rig.sim("--seed", "3")
    with rig.link(people.of("operator.alice")) as link:
        ready = link.wait_for(lambda s: s.health is not None and s.health.ready, 60.0)
        assert ready is not None, rig.output("air")
    return people


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
@pytest.mark.parametrize(("loss", "delay_s"), [(0.0, 0.25), (0.3, 0.02), (0.1, 0.25)])
def test_start_and_stop_arrive_over_packets_that_are_lost_and_late(rig: Rig, loss: float, delay_s: float) -> None:
    people = ready_vehicle(rig)
    with LossyNet(loss=loss, delay_s=delay_s) as net:
        begun = time.monotonic()
        status = goshawk(net, people, rig, "status", "--json", "--timeout", "60")
        assert json.loads(status.stdout)["mode"] == "ready", status.stderr
        print(f"{loss:.0%} lost, {delay_s:g} s late: the heartbeat after {time.monotonic() - begun:.1f} s", end="; ")
        start = goshawk(net, people, rig, "start", "--json", "--timeout", "60")
        assert json.loads(start.stdout)["accepted"], start.stderr
        stop = goshawk(net, people, rig, "stop", "--json", "--timeout", "60")
        assert json.loads(stop.stdout)["accepted"], stop.stderr
        print(f"stop confirmed after {json.loads(stop.stdout)['took_s']:.1f} s; {net.lost} of "
              f"{net.lost + net.carried} packets lost")  # fmt: skip
        assert net.carried > 0
        assert (net.lost > 0) == (loss > 0)
    told = Path(rig.folder / "air.out").read_text()
    assert "stop accepted" in told
    assert "the last image is" not in told  # whoever is slow to hear holds up nothing that the vehicle sees
