"""The ground sends a vehicle in flight to a Rerun viewer: here the one that writes what it gets into a file."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.cli import app
from goshawk_ground.link import GroundLink
from goshawk_ground.pages.tools import rerun_feeds
from goshawk_proto import goshawk_pb2 as pb
from rerun.chunk import RrdReader
from typer.testing import CliRunner

Fakes = Callable[..., Any]
ENTITIES = {
    "/world/body", "/world/path", "/world/plan/candidates", "/world/plan/chosen", "/world/target/estimate",
    "/world/remembered", "/world/body/camera/image", "/speed/total", "/acceleration/up/disturbance", "/events",
}  # fmt: skip


def whole(snap: Snapshot) -> bool:
    """Whether every channel has told something."""
    return None not in (snap.plan, snap.remembered, snap.target, snap.preview) and len(snap.events) > 0


def test_a_rerun_viewer_gets_the_entities_of_the_export(fake_vehicle: Fakes, tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    got = tmp_path / "got.rrd"
    viewer = subprocess.Popen(
        [sys.executable, "-m", "rerun", "--save", got, "--port", str(port)], stderr=subprocess.PIPE, text=True
    )
    try:
        assert viewer.stderr is not None
        said = next(line for line in viewer.stderr if re.search(r"[Ll]istening", line))
        assert str(port) in said
        with GroundLink(connect=fake_vehicle().endpoint) as link:
            (feed,) = rerun_feeds([link], f"rerun+http://127.0.0.1:{port}/proxy")
            with feed:
                assert link.wait_for(lambda s: s.health is not None and s.health.ready, 30.0) is not None
                assert link.start().accepted
                assert link.wait_for(lambda s: s.mode == pb.MODE_TRACK and whole(s), 30.0) is not None
    finally:
        viewer.send_signal(signal.SIGINT)
        viewer.wait(timeout=20.0)
    assert {str(chunk.entity_path) for chunk in RrdReader(got).stream()} >= ENTITIES


def test_what_is_no_address_of_a_viewer_is_one_line(free_endpoint: str) -> None:
    done = CliRunner().invoke(app, ["ground", "--connect", free_endpoint, "--rerun", "nowhere"])
    assert done.exit_code == 2
    assert "'nowhere' is no address of a Rerun viewer" in done.stderr


def test_without_rerun_it_says_how_to_install_it(free_endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    for name in ("rerun_live", "rerun_file"):
        monkeypatch.delitem(sys.modules, f"goshawk_dashboards.exports.{name}", raising=False)
    done = CliRunner().invoke(
        app, ["ground", "--connect", free_endpoint, "--rerun", "rerun+http://127.0.0.1:9876/proxy"]
    )
    assert done.exit_code == 2
    assert "make setup-rerun" in done.stderr
