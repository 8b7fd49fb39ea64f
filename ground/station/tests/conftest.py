"""A vehicle to talk to: a real Zenoh session in a process of its own, on a free port."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
FAKE = ROOT / "tests/browser/fake_vehicle.py"


@pytest.fixture(scope="session", autouse=True)
def terminal() -> Iterator[None]:
    """Tests and their programs hear that a terminal closes, even under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@dataclass(frozen=True, kw_only=True)
class Fake:
    """A running stand-in vehicle."""

    endpoint: str
    process: subprocess.Popen[str]

    def kill(self) -> None:
        """Gone without a goodbye."""
        self.process.kill()
        self.process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def free_endpoint() -> str:
    """An endpoint nobody listens on."""
    return f"tcp/127.0.0.1:{_free_port()}"


@pytest.fixture
def fake_vehicle(free_endpoint: str) -> Iterator[Callable[..., Fake]]:
    """Starts stand-ins with the given flags, at ``free_endpoint`` unless told; ends them afterwards."""
    started: list[subprocess.Popen[str]] = []

    def start(*flags: str, endpoint: str = free_endpoint) -> Fake:
        process = subprocess.Popen(
            [sys.executable, str(FAKE), "--listen", endpoint, *flags], stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "listening\n"
        return Fake(endpoint=endpoint, process=process)

    yield start
    for process in started:
        process.terminate()
    for process in started:
        try:
            process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()
