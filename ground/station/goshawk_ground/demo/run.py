"""The whole demonstration: simulator, vehicle and ground station as three processes, and a verdict on each flight."""

from __future__ import annotations

import dataclasses
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from goshawk_dashboards.live.dashboard import LiveDashboard
from goshawk_dashboards.page.status import failing_checks
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_proto import goshawk_pb2 as pb
from rich.console import Console

from goshawk_ground.demo import places, report
from goshawk_ground.demo.browser import await_browser
from goshawk_ground.demo.children import Child, stop_all
from goshawk_ground.demo.director import Action, Director, Limits, Phase
from goshawk_ground.demo.flight_record import FlightRecord, Summary, goal_distance_m
from goshawk_ground.keys.chosen import demo_identities
from goshawk_ground.link import GroundLink
from goshawk_ground.pages.ports import free_port
from goshawk_ground.pages.serve import serve_dashboard
from goshawk_ground.process.interrupt import interrupted

ZENOH_PORT = 7447
MAVLINK_PORT = 14540
GOAL_BEYOND_M = 10.0
"""The target starts up to 6 m ahead of the vehicle, so its goal lies this much beyond the distance it is to run."""


class DemoError(RuntimeError):
    """The demo cannot run at all; one line says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """What the command line asked for."""

    seed: int
    navigate: bool
    """Fly to the goal of navigate.toml, which says where and how fast; else chase."""
    headless: bool
    speed_mps: float
    spacing_m: float
    distance_m: float
    port: int
    bin_dir: Path
    log_dir: Path
    json_file: Path | None
    px4: Path | None = None
    """Fly the motors by this build of PX4 …"""
    ardupilot: Path | None = None
    """… or of ArduPilot; none of both: the simulator's stand-in."""


class _EndedError(Exception):
    """Somebody wants the demo to end now."""


def run_demo(options: DemoOptions) -> bool:
    """Flies once; whether it succeeded. Every child is gone when it returns, whatever happened."""
    console = Console(highlight=False)
    _check(options)
    if options.navigate:
        distance_m, speed_mps = places.goal_of(_vehicle_file(options))
        options = dataclasses.replace(options, distance_m=distance_m, speed_mps=speed_mps)
    children: list[Child] = []
    link: GroundLink | None = None
    dashboard: LiveDashboard | None = None
    # A socket's path must be short, and this folder is the user's alone.
    with tempfile.TemporaryDirectory(prefix="goshawk-") as sockets, interrupted() as ended:
        commands, endpoint, identity, folder = _prepare(options, console, sockets)
        try:
            for name, command in commands.items():  # one by one: where the second cannot run, the first is stopped
                children.append(Child(name, command, folder / f"{name}.log"))
            link = GroundLink(connect=endpoint, identity=identity)
            dashboard = serve_dashboard(link, host="127.0.0.1", port=free_port(options.port))
            console.print(f"dashboard: {dashboard.url}", style="bold", markup=False)
            if console.is_terminal and not options.headless:
                await_browser(dashboard, console, ended)
            summary = _fly(options, link, children, console, ended, Phase.WAITING_READY)
            report.show(summary, children, console)
            if options.json_file is not None:
                report.write(summary, options.seed, options.json_file)
            if not options.headless:
                console.print(f"the dashboard stays at {dashboard.url}: Start flies again, Ctrl-C ends", markup=False)
                fly_on(options, link, children, console, ended)
            return summary.succeeded
        except _EndedError:
            console.print("interrupted: stopping everything")
            return False
        except OSError as error:
            raise DemoError(str(error)) from error
        finally:
            # Nothing cuts this short, not even another Ctrl-C; it is bounded by itself.
            if dashboard is not None:
                dashboard.close()
            if link is not None:
                link.close()
            stop_all(children)


def _check(options: DemoOptions) -> None:
    for needed in (options.bin_dir / "goshawk-air", options.bin_dir / "goshawk-sim", _vehicle_file(options)):
        if not needed.is_file():
            todo = "run from the repository's root after `make setup`, or install the package goshawk-sim"
            raise DemoError(f"{needed} is missing: {todo}")
    if options.json_file is not None and not options.json_file.parent.is_dir():
        raise DemoError(f"--json {options.json_file}: {options.json_file.parent} is no folder")
    for flag, firmware, folder in (("--px4", "PX4", options.px4), ("--ardupilot", "ArduPilot", options.ardupilot)):
        if folder is not None and not folder.is_dir():
            what = "is not a folder" if folder.exists() else "does not exist"
            raise DemoError(f"{flag} {folder} {what}: name that of {firmware}'s sources, or of its build")


def _prepare(options: DemoOptions, console: Console, sockets: str) -> tuple[dict[str, list[str]], str, Path, Path]:
    """The two commands by name, the vehicle's endpoint, the operator's identity, and the folder for their output."""
    air, sim = options.bin_dir / "goshawk-air", options.bin_dir / "goshawk-sim"
    vehicle = _vehicle_file(options)
    folder = options.log_dir / time.strftime("demo-%Y%m%d-%H%M%S")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        zenoh_port, mavlink_port = free_port(ZENOH_PORT), free_port(MAVLINK_PORT, udp=True)
    except OSError as error:
        raise DemoError(str(error)) from error
    if options.px4 is not None and mavlink_port != MAVLINK_PORT:
        raise DemoError(f"udp {MAVLINK_PORT} is busy, where PX4 speaks to the vehicle: end what has it, and try again")
    if (zenoh_port, mavlink_port) != (ZENOH_PORT, MAVLINK_PORT):
        console.print(f"usual ports are busy: using tcp {zenoh_port} and udp {mavlink_port}")
    flown, flier = demo_identities(folder / "keys")
    endpoint = f"tls/127.0.0.1:{zenoh_port}"
    sensors = f"unixsock-stream/{sockets}/sensors.sock"
    at, firmware = _autopilot(options, mavlink_port)
    commands = {
        "air": [
            str(air), "run", "--config", str(vehicle), "--listen", endpoint, "--listen", sensors,
            "--identity", str(flown), "--log-dir", str(folder), *at,
        ],
        "sim": [
            str(sim), "serve", "--seed", str(options.seed), "--spacing", f"{options.spacing_m:g}", *_task(options),
            "--connect", sensors, "--vehicle-file", str(vehicle), *firmware,
        ],
    }  # fmt: skip
    return commands, endpoint, flier, folder


def _vehicle_file(options: DemoOptions) -> Path:
    if options.navigate:
        return places.vehicle_file("navigate.toml")
    return places.vehicle_file("sim.toml" if options.ardupilot is None else "ardupilot-sitl.toml")


def _task(options: DemoOptions) -> list[str]:
    """What says to the simulator who runs, or where the goal lies."""
    if options.navigate:
        return ["--task", "navigate", "--distance", f"{options.distance_m:g}"]
    return ["--speed", f"{options.speed_mps:g}", "--distance", f"{options.distance_m + GOAL_BEYOND_M:g}"]


def _autopilot(options: DemoOptions, mavlink_port: int) -> tuple[list[str], list[str]]:
    """What says to the vehicle where its autopilot is, and to the simulator who that is."""
    if options.px4 is not None:
        return [], ["--autopilot", "px4", "--firmware", str(options.px4)]
    if options.ardupilot is not None:
        return [], ["--autopilot", "ardupilot", "--firmware", str(options.ardupilot)]
    return ["--mavlink-bind", f"127.0.0.1:{mavlink_port}"], ["--mavlink-port", str(mavlink_port)]


def _fly(
    options: DemoOptions,
    link: GroundLink,
    children: list[Child],
    console: Console,
    ended: threading.Event,
    phase: Phase,
) -> Summary:
    """One flight from ``phase`` to landing."""
    record = FlightRecord(options.distance_m, navigates=options.navigate)
    lock = threading.Lock()

    def listen(channel: str, view: Any) -> None:
        with lock:
            if channel == "sim_truth":
                record.saw_truth(view)
            elif channel == "health":
                record.saw_health(view)
            elif channel == "control":
                record.saw_mode(view.mode)

    end_listening = link.listen(listen)
    before = link.snapshot().command
    asked_before = None if before is None else before.command_id
    chase_s = 3.0 * options.distance_m / options.speed_mps + 30.0
    # Real firmware boots, and finds itself by its sensors.
    ready_s = 60.0 if options.px4 is None and options.ardupilot is None else 150.0
    director = Director(Limits(chase_s=chase_s, ready_s=ready_s), time.monotonic(), phase)
    trouble: tuple[str, ...] = ()
    with console.status(director.phase.value) as status:
        while not trouble:
            if ended.wait(0.02):
                raise _EndedError
            snap = link.snapshot()
            with lock:
                arrived, collided = record.arrived, record.collided
            action = director.step(
                time.monotonic(),
                mode=snap.mode,
                ready=snap.health is not None and snap.health.ready,
                arrived=arrived,
                collided=collided,
                stopped=_stopped(snap, asked_before),
                why_not_ready="; ".join(failing_checks(snap)),
            )
            if action is Action.START:
                reply = link.start()
                if not reply.accepted:
                    director.refused(time.monotonic(), reply.text)
            elif action is Action.STOP:
                link.press_stop()
            elif action is Action.END:
                break
            status.update(_progress(director.phase, snap))
            trouble = tuple(
                f"{child.name} ended by itself (status {child.exit_code}), see {child.output}"
                for child in children
                if child.exit_code is not None
            )
    end_listening()
    with lock:
        return record.summary(trouble + ((director.failure,) if director.failure else ()))


def _stopped(snap: Snapshot, asked_before: str | None) -> bool:
    """Whether Stop was pressed since ``asked_before``."""
    asked = snap.command
    return asked is not None and asked.verb == "stop" and asked.command_id != asked_before


def _progress(phase: Phase, snap: Snapshot) -> str:
    words = phase.value
    if phase is Phase.WAITING_READY:
        words += ": " + ("; ".join(failing_checks(snap)) or "ready")
    elif phase is Phase.UNDER_WAY and snap.truth is not None:
        truth = snap.truth
        chase = f"the target has run {truth.target_path_m:.0f} m, {truth.target_distance_m:.1f} m ahead"
        goal = f"the goal is {goal_distance_m(truth):.0f} m away"
        words += f": {chase if truth.goal_world_3 is None else goal}; clearance {truth.clearance_m:.2f} m"
    return words.replace("[", r"\[")


def fly_on(
    options: DemoOptions, link: GroundLink, children: list[Child], console: Console, ended: threading.Event
) -> None:
    """Judges each flight that Start on the dashboard begins, until Ctrl-C or a child's end."""
    while all(child.exit_code is None for child in children):
        if ended.wait(0.1):
            return
        if link.snapshot().mode == pb.MODE_TAKEOFF:
            console.print("")
            report.show(_fly(options, link, children, console, ended, Phase.TAKING_OFF), children, console)
    for child in children:
        if child.exit_code is not None:
            console.print(f"{child.name} ended (status {child.exit_code}), see {child.output}", markup=False)
