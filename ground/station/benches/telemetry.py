"""What one vehicle's telemetry costs, preview aside: bytes on the wire, and a core on board.

    python telemetry.py [--seconds 20]

The simulator, the real onboard process and a ground that subscribes to all but the preview, over real Zenoh; between
vehicle and ground a proxy counts the bytes of the TCP stream, Zenoh's own included. On board it is the core time of the
telemetry thread (which encodes, judges readiness, makes the preview and feeds the recorder, so it is more than the
telemetry alone) and of Zenoh's sending threads. A machine too busy to keep up sends less: the bytes are given for the
full rates, by each channel's own size and what the wire adds to it; the core's share says nothing then and is not
recorded. Flown twice in one run, by plain TCP and by TLS with certificates on both sides. The keys: `telemetry_kBps`,
`telemetry_core_fraction`, `telemetry_tls_kBps`, `telemetry_tls_core_fraction`.
"""

from __future__ import annotations

import argparse
import socket
import subprocess
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import zenoh
from common import ROOT, core_seconds_of_threads, free_port, record, verdict
from goshawk_ground.keys.chosen import demo_identities
from goshawk_ground.link import GroundLink
from goshawk_ground.link.dial import Way
from goshawk_proto import goshawk_pb2 as pb
from goshawk_proto import key_expression

CHANNELS = ("plan", "control", "target", "health", "event")
FULL_HZ = {"plan": 60.0, "target": 60.0, "control": 50.0, "health": 2.0}
KEEPS_UP = 0.9
"""Of the full rate of planning: with less, the machine was too busy."""
TARGET_KBPS = 120.0
TARGET_CORE = {"tcp": 0.01, "tls": 0.015}
KEY = {"tcp": "telemetry", "tls": "telemetry_tls"}
SENDING = ("telemetry", "tx")
"""How the names of the threads on board begin that telemetry costs."""


class CountingProxy:
    """Passes one TCP connection on, and counts what the far side sends."""

    def __init__(self, port: int, far_port: int) -> None:
        self.received = 0
        self._listener = socket.create_server(("127.0.0.1", port))
        self._far_port = far_port
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        near, _ = self._listener.accept()
        far = socket.create_connection(("127.0.0.1", self._far_port))
        for end in (near, far):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        threading.Thread(target=self._pump, args=(near, far, False), daemon=True).start()
        self._pump(far, near, True)

    def _pump(self, source: socket.socket, sink: socket.socket, count: bool) -> None:
        try:
            while data := source.recv(65536):
                self.received += len(data) if count else 0
                sink.sendall(data)
        except OSError:
            pass  # an end has gone: the measurement is over


def start(stack: ExitStack, folder: Path, endpoint: str, identity: Path | None) -> int:
    """The vehicle and the simulator, ended with the stack; the vehicle's process id."""
    mavlink = free_port(socket.SOCK_DGRAM)
    sensors = endpoint if identity is None else f"unixsock-stream/{folder}/sensors.sock"
    guarded = [] if identity is None else ["--listen", sensors, "--identity", str(identity)]
    bins = ROOT / "target/release"
    commands = (
        [
            str(bins / "goshawk-air"), "run", "--config", str(ROOT / "air/vehicles/sim.toml"), "--listen", endpoint,
            "--mavlink-bind", f"127.0.0.1:{mavlink}", "--log-dir", str(folder), *guarded,
        ],
        [
            str(bins / "goshawk-sim"), "serve", "--seed", "3", "--spacing", "6", "--speed", "2", "--distance", "400",
            "--frame-rate", "60", "--connect", sensors, "--mavlink-port", str(mavlink),
        ],
    )  # fmt: skip
    pids: list[int] = []
    for k, command in enumerate(commands):
        output = stack.enter_context((folder / f"{k}.out").open("wb"))
        try:
            process = subprocess.Popen(command, stdout=output, stderr=output)
        except OSError as error:
            raise SystemExit(f"cannot run {command[0]}: {error.strerror}; `make build` makes it") from error
        stack.callback(process.wait, timeout=20)
        stack.callback(process.terminate)
        pids.append(process.pid)
    return pids[0]


def main() -> None:
    """Flies, measures and records."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="how long to measure, in flight")
    seconds = parser.parse_args().seconds
    for protocol in ("tcp", "tls"):
        fly(protocol, seconds)


def fly(protocol: str, seconds: float) -> None:
    """One flight, measured."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        port, proxied = free_port(), free_port()
        flown, flier = demo_identities(folder) if protocol == "tls" else (None, None)
        pid = start(stack, folder, f"{protocol}/127.0.0.1:{port}", flown)
        pilot = stack.enter_context(GroundLink(connect=f"{protocol}/127.0.0.1:{port}", identity=flier))
        if pilot.wait_for(lambda s: s.mode == pb.MODE_READY, 60) is None or not pilot.start(timeout_s=10).accepted:
            raise SystemExit("the vehicle did not start: " + pilot.why_silent(60))
        if pilot.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.plan is not None, 40) is None:
            raise SystemExit("the vehicle never tracked its target")
        vehicle = pilot.vehicle
        pilot.close()
        proxy = CountingProxy(proxied, port)
        way = Way(f"{protocol}/127.0.0.1:{proxied}", vehicle, flier)
        stack.callback(way.close)
        session = stack.enter_context(zenoh.open(way.config))
        sizes: dict[str, list[int]] = {name: [] for name in CHANNELS}

        def take(name: str, sample: zenoh.Sample) -> None:
            sizes[name].append(len(sample.payload))

        kept = [
            session.declare_subscriber(key_expression(name, vehicle), lambda sample, name=name: take(name, sample))
            for name in CHANNELS
        ]
        time.sleep(2.0)
        report(protocol, pid, proxy, sizes, seconds)
        for subscriber in kept:
            subscriber.undeclare()


def report(protocol: str, pid: int, proxy: CountingProxy, sizes: dict[str, list[int]], seconds: float) -> None:
    """Watches for a while, then prints and records."""
    began_s, wire_before, before = time.monotonic(), proxy.received, core_seconds_of_threads(pid)
    for seen in sizes.values():
        seen.clear()
    time.sleep(seconds)
    after, wire = core_seconds_of_threads(pid), proxy.received - wire_before
    took_s, seen = time.monotonic() - began_s, {name: list(values) for name, values in sizes.items()}
    rates = {name: len(values) / took_s for name, values in seen.items()}
    if not seen["plan"] or not seen["control"]:
        raise SystemExit("the flight ended before it was measured")
    wire_per_byte = wire / sum(map(sum, seen.values()))
    full = {name: max(rates[name], FULL_HZ.get(name, 0.0)) for name in CHANNELS}
    sent = {name: full[name] * sum(values) / len(values) for name, values in seen.items() if values}
    kbps = wire_per_byte * sum(sent.values()) / 1000.0
    spent = {name: (s - before.get(name, 0.0)) / took_s for name, s in after.items()}
    parts = {name: s for name, s in spent.items() if name.startswith(SENDING)}
    share = sum(parts.values())
    target = TARGET_CORE[protocol]
    print(f"telemetry of one vehicle in flight, without preview, {took_s:.0f} s over real Zenoh by {protocol}")
    print("  rates reached       " + ", ".join(f"{name} {hz:.1f} Hz" for name, hz in rates.items()))
    print(f"  bytes on the wire   {kbps:8.1f} kB/s at 60 Hz   target {TARGET_KBPS:.0f}: {verdict(kbps <= TARGET_KBPS)}")
    print("  of which            " + ", ".join(f"{n} {wire_per_byte * b / 1000:.1f}" for n, b in sent.items()))
    within = verdict(share <= target)
    print(f"  share of a core     {100 * share:8.2f} %                target {100 * target:g} %: {within}")
    print("  of which            " + ", ".join(f"{n} {100 * s:.2f} %" for n, s in sorted(parts.items())))
    print(f"  the whole process   {100 * sum(spent.values()):8.1f} % (yardstick)")
    record(f"{KEY[protocol]}_kBps", round(kbps, 1))
    if rates["plan"] < KEEPS_UP * FULL_HZ["plan"]:
        raise SystemExit("the core's share is not recorded: this machine is too busy to plan at 60 Hz")
    record(f"{KEY[protocol]}_core_fraction", round(share, 4))


if __name__ == "__main__":
    main()
