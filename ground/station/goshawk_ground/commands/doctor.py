"""`goshawk doctor`: prints the findings."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from goshawk_ground.commands.options import (
    NO_REPLY,
    REFUSED,
    BinDir,
    Connect,
    Identity,
    Json,
    Timeout,
    Vehicle,
    fail,
    print_json,
)
from goshawk_ground.demo import places
from goshawk_ground.doctor.findings import Finding, State
from goshawk_ground.doctor.ground import OURS, version
from goshawk_ground.doctor.link import link_findings, measure
from goshawk_ground.doctor.roles import Role, local_findings
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, LinkError

_STYLES = {State.OK: "green", State.NOTE: "yellow", State.BAD: "red"}


def doctor(
    vehicle: Vehicle = DEFAULT_VEHICLE,
    connect: Connect = DEFAULT_CONNECT,
    identity: Identity = None,
    timeout: Timeout = 3.0,
    offline: Annotated[bool, typer.Option("--offline", help="Leave the vehicle out.")] = False,
    role: Annotated[
        Role | None,
        typer.Option(help="What this machine is for; absent: developer in a checkout, else laptop."),
    ] = None,
    bin_dir: BinDir = None,
    as_json: Json = False,
) -> None:
    """What is installed, found, free and reachable, each line with what to do. Exit status 1 if something is broken."""
    role = role or (Role.DEVELOPER if places.in_checkout() else Role.LAPTOP)
    findings = list(local_findings(role, bin_dir or places.programs()))
    if not offline:
        try:
            facts = measure(vehicle, connect, timeout, identity)
        except (LinkError, ValueError) as error:
            fail(f"cannot use --vehicle {vehicle} --connect {connect}: {error}", NO_REPLY)
        findings += link_findings(facts, version(OURS) or "unknown")
    broken = any(finding.state is State.BAD for finding in findings)
    if as_json:
        print_json({"ok": not broken, "findings": [dataclasses.asdict(finding) for finding in findings]})
    else:
        _print(findings)
    if broken:
        raise typer.Exit(REFUSED)


def _print(findings: list[Finding]) -> None:
    table = Table(box=None, pad_edge=False, show_header=False)
    for finding in findings:
        text = finding.text + (f"\n→ {finding.todo}" if finding.todo else "")
        table.add_row(
            Text(finding.state.value, style=_STYLES[finding.state]), Text(finding.name), Text(text, overflow="fold")
        )
    Console(highlight=False).print(table)


def register(app: typer.Typer) -> None:
    """Adds the command to the `goshawk` command."""
    app.command(
        epilog="Examples: goshawk doctor --offline | goshawk doctor --role vehicle | "
        "goshawk doctor --vehicle hawk --connect tls/192.168.1.7:7447 | goshawk doctor --json | jq .ok"
    )(doctor)
