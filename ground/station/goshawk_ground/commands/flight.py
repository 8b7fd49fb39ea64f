"""The commands that a flight needs: `start`, `stop`, `status`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from goshawk_dashboards.state import protocol, words
from goshawk_dashboards.state.snapshot import FLYING, Snapshot
from goshawk_dashboards.state.views import CommandView
from rich.console import Console
from rich.table import Table

from goshawk_ground.commands.options import (
    A_DAY_S,
    NO_REPLY,
    REFUSED,
    Connect,
    Identity,
    Json,
    Timeout,
    Vehicle,
    fail,
    print_json,
    readable,
)
from goshawk_ground.commands.stopping import stop_until_confirmed
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, GroundLink, LinkError

ELSEWHERE = "--vehicle hawk --connect tls/192.168.1.7:7447"
"""In examples: a vehicle that is not on this computer."""


def open_link(vehicle: str, connect: str, identity: Path | None) -> GroundLink:
    """The link, or one line about what is wrong with the arguments."""
    try:
        return GroundLink(vehicle=vehicle, connect=connect, identity=identity)
    except LinkError as error:
        fail(f"cannot use --vehicle {vehicle} --connect {connect}: {error}", NO_REPLY)


def _report(view: CommandView, as_json: bool) -> None:
    mode = None if view.mode is None else words.mode(view.mode)
    if as_json:
        print_json({**dataclasses.asdict(view), "mode": mode})
    if view.refused_here:
        fail(f"{view.verb} not sent: {view.text}", REFUSED)
    if not view.answered:
        fail(view.text, NO_REPLY)
    if not view.accepted:
        advice = ". Pilot: take over." if view.verb == "stop" else ""
        fail(f"{view.verb} refused ({mode}): {view.text}{advice}", REFUSED)
    if not as_json:
        typer.echo(f"{view.verb} accepted ({mode}): {view.text}")


def start(
    profile: Annotated[
        str, typer.Option(help="A start profile of the vehicle file; empty: its default.", callback=readable)
    ] = "",
    vehicle: Vehicle = DEFAULT_VEHICLE,
    connect: Connect = DEFAULT_CONNECT,
    identity: Identity = None,
    timeout: Timeout = 5.0,
    as_json: Json = False,
) -> None:
    """Begin the flight. Exit status 1 if the vehicle refuses, 2 if it does not answer."""
    with open_link(vehicle, connect, identity) as link:
        _report(link.start(profile, timeout_s=timeout), as_json)


def stop(
    vehicle: Vehicle = DEFAULT_VEHICLE,
    connect: Connect = DEFAULT_CONNECT,
    identity: Identity = None,
    timeout: Annotated[
        float | None,
        typer.Option(min=0.1, max=A_DAY_S, help="Seconds after which it gives up; absent: only Ctrl-C ends it."),
    ] = None,
    as_json: Json = False,
) -> None:
    """End the flight: brake, land, disarm. Asks until the vehicle confirms. Exit status 1 if refused, 2 if not
    delivered."""
    with open_link(vehicle, connect, identity) as link:
        _report(stop_until_confirmed(link, timeout), as_json)


def status(
    vehicle: Vehicle = DEFAULT_VEHICLE,
    connect: Connect = DEFAULT_CONNECT,
    identity: Identity = None,
    timeout: Timeout = 5.0,
    as_json: Json = False,
) -> None:
    """The newest heartbeat: mode, readiness with reasons, rates. Exit status 1 if not ready, 2 if silent."""
    with open_link(vehicle, connect, identity) as link:
        snap = link.wait_for(lambda s: s.health is not None, timeout)
        if snap is None or snap.health is None:
            fail(link.why_silent(timeout), NO_REPLY)
    health = snap.health
    if as_json:
        print_json({**dataclasses.asdict(health), "mode": words.mode(health.mode)})
    else:
        _print_status(snap)
    if protocol.mismatch(health) or not (health.ready or health.mode in FLYING):
        raise typer.Exit(REFUSED)


def _print_status(snap: Snapshot) -> None:
    health = snap.health
    if health is None:
        return
    console = Console(highlight=False)
    if other := protocol.mismatch(health):
        console.print(f"[red]{_literal(other)}[/red]", soft_wrap=True)
    autopilot = health.autopilot or "unknown"
    ready = "ready" if health.ready else "not ready"
    console.print(f"[bold]{health.vehicle}[/bold]  {words.mode(health.mode)}, {ready}; autopilot {autopilot}")
    checks = Table("", "check", "reason", box=None, pad_edge=False, show_header=False)
    for check in sorted(health.checks, key=lambda c: c.ok):
        mark = "[green]ok[/green]" if check.ok else "[red]no[/red]"
        checks.add_row(mark, check.name, _literal(check.reason))
    console.print(checks)
    figures = [f"{name} {hz:.1f} Hz" for name, hz in health.rates_hz]
    figures += [f"{x.name} p50 {x.p50_ms:.2f} p99 {x.p99_ms:.2f} ms" for x in health.latencies]
    if health.battery_fraction is not None:
        figures.append(f"battery {100 * health.battery_fraction:.0f} %")
    console.print("; ".join(figures))
    for fault in health.faults:
        console.print(f"[red]fault[/red] {_literal(fault)}")
    console.print(
        f"profile {health.profile or '-'}; version {health.version or '-'}; policy {health.policy_sha256[:12] or '-'}; "
        f"log {health.log_path or 'not recording'}",
        markup=False,
    )


def _literal(text: str) -> str:
    return text.replace("[", r"\[")


def register(app: typer.Typer) -> None:
    """Adds the commands to the `goshawk` command."""
    app.command(epilog=f"Examples: goshawk start | goshawk start {ELSEWHERE} --profile chase")(start)
    app.command(epilog=f"Examples: goshawk stop | goshawk stop {ELSEWHERE} --timeout 10")(stop)
    app.command(epilog="Examples: goshawk status | goshawk status --json | jq .ready")(status)
