"""Real processes over real Zenoh and MAVLink on loopback, each on ports of its own."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from goshawk_ground.link import GroundLink

ROOT = Path(__file__).resolve().parents[2]
BIN = ROOT / "target/release"
VEHICLE = ROOT / "air/vehicles/sim.toml"


def copied() -> str:
    """The shipped vehicle file's text, to be written into another folder."""
    text = VEHICLE.read_text().replace("../models", str(VEHICLE.parent.parent / "models"))
    return text.replace('"tuning.toml"', f'"{VEHICLE.parent}/tuning.toml"')


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass(kw_only=True)
class Rig:
    """The ports and processes of one test."""

    folder: Path
    zenoh_port: int = field(default_factory=free_port)
    mavlink_port: int = field(default_factory=lambda: free_port(socket.SOCK_DGRAM))
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict[str, subprocess.Popen[bytes]])
    identity: Path | None = None
    """The vehicle's: then grounds need one too, and the simulator comes by a unix socket."""

    @property
    def endpoint(self) -> str:
        return f"{'tcp' if self.identity is None else 'tls'}/127.0.0.1:{self.zenoh_port}"

    @property
    def socket(self) -> str:
        return f"unixsock-stream/{self.folder}/sensors.sock"

    @property
    def logs(self) -> Path:
        return self.folder / "logs"

    def spawn(self, name: str, *command: str | Path) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.out").open("wb") as out:
            process = subprocess.Popen([str(c) for c in command], stdout=out, stderr=out, start_new_session=True)
        self.processes[name] = process
        return process

    def air_command(self, *arguments: str | Path, vehicle: Path = VEHICLE) -> list[str]:
        guarded = () if self.identity is None else ("--listen", self.socket, "--identity", self.identity)
        command = (
            BIN / "goshawk-air", "run", "--config", vehicle, "--listen", self.endpoint, *guarded,
            "--mavlink-bind", f"127.0.0.1:{self.mavlink_port}", "--log-dir", self.logs, *arguments,
        )  # fmt: skip
        return [str(part) for part in command]

    def air(self, *arguments: str | Path, vehicle: Path = VEHICLE) -> subprocess.Popen[bytes]:
        return self.spawn("air", *self.air_command(*arguments, vehicle=vehicle))

    def sim(self, *arguments: str) -> subprocess.Popen[bytes]:
        return self.spawn(
            "sim", BIN / "goshawk-sim", "serve", "--connect", self.endpoint if self.identity is None else self.socket,
            "--mavlink-port", str(self.mavlink_port), *arguments,
        )  # fmt: skip

    def output(self, name: str) -> str:
        return (self.folder / f"{name}.out").read_text(errors="replace")

    def link(self, identity: Path | None = None) -> GroundLink:
        return GroundLink(connect=self.endpoint, identity=identity)

    def close(self) -> None:
        for process in self.processes.values():
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
        for process in self.processes.values():
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
