"""The `goshawk` command line. Exit status: 0 done, 1 refused or failed, 2 no reply or wrong usage."""

from __future__ import annotations

import dataclasses
import json
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer
from goshawk_dashboards.state import protocol, words
from goshawk_dashboards.state.snapshot import FLYING, Snapshot
from goshawk_dashboards.state.views import CommandView
from rich.console import Console
from rich.table import Table

from goshawk_ground.commands import doctor, keys_transfer, logs, trainer
from goshawk_ground.commands.options import (
    NO_REPLY,
    REFUSED,
    BinDir,
    CertificateFile,
    Connect,
    Host,
    Identity,
    Json,
    KeyFile,
    ObserverPassword,
    OperatorPassword,
    Port,
    Timeout,
    TokenFile,
    Vehicle,
    fail,
)
from goshawk_ground.commands.stopping import stop_until_confirmed, wait_for_interrupt
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, GroundLink, LinkError
from goshawk_ground.orders.stop_file import state_folder
from goshawk_ground.orders.stop_latch import RESUME_S

app = typer.Typer(
    name="goshawk",
    help="Start, stop, watch and review a Goshawk vehicle.",
    epilog="Typical: goshawk ground, then open the printed address; or goshawk demo, which needs no vehicle.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)


def open_link(vehicle: str, connect: str, identity: Path | None) -> GroundLink:
    """The link, or one line about what is wrong with the arguments."""
    try:
        return GroundLink(vehicle=vehicle, connect=connect, identity=identity)
    except LinkError as error:
        fail(f"cannot use --vehicle {vehicle} --connect {connect}: {error}", NO_REPLY)


def _report(view: CommandView, as_json: bool) -> None:
    mode = None if view.mode is None else words.mode(view.mode)
    if as_json:
        typer.echo(json.dumps({**dataclasses.asdict(view), "mode": mode}))
    if view.refused_here:
        fail(f"{view.verb} not sent: {view.text}", REFUSED)
    if not view.answered:
        fail(view.text, NO_REPLY)
    if not view.accepted:
        advice = ". Pilot: take over." if view.verb == "stop" else ""
        fail(f"{view.verb} refused ({mode}): {view.text}{advice}", REFUSED)
    if not as_json:
        typer.echo(f"{view.verb} accepted ({mode}): {view.text}")


@app.command(epilog="Examples: goshawk start | goshawk start --profile fast --connect tcp/192.168.1.7:7447")
def start(
    profile: Annotated[str, typer.Option(help="A start profile of the vehicle file; empty: its default.")] = "",
    vehicle: Vehicle = DEFAULT_VEHICLE,
    connect: Connect = DEFAULT_CONNECT,
    identity: Identity = None,
    timeout: Timeout = 5.0,
    as_json: Json = False,
) -> None:
    """Begin the flight. Exit status 1 if the vehicle refuses, 2 if it does not answer."""
    with open_link(vehicle, connect, identity) as link:
        _report(link.start(profile, timeout_s=timeout), as_json)


@app.command(epilog="Examples: goshawk stop | goshawk stop --connect tcp/192.168.1.7:7447 --timeout 10")
def stop(
    vehicle: Vehicle = DEFAULT_VEHICLE,
    connect: Connect = DEFAULT_CONNECT,
    identity: Identity = None,
    timeout: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds after which it gives up; absent: only Ctrl-C ends it.")
    ] = None,
    as_json: Json = False,
) -> None:
    """End the flight: brake, land, disarm. Asks until the vehicle confirms. Exit status 1 if refused, 2 if not
    delivered."""
    with open_link(vehicle, connect, identity) as link:
        _report(stop_until_confirmed(link, timeout), as_json)


@app.command(epilog="Examples: goshawk status | goshawk status --json | jq .ready")
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
        typer.echo(json.dumps({**dataclasses.asdict(health), "mode": words.mode(health.mode)}))
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


@app.command(
    epilog="Examples: goshawk ground | goshawk ground --connect tcp/192.168.1.7:7447 --autopilot udpin:0.0.0.0:14550 | "
    "goshawk ground --vehicle alpha@tcp/192.168.1.7:7447 --vehicle bravo@tcp/192.168.1.8:7447 | "
    "goshawk ground --host 0.0.0.0 --operator-password-file operator.txt --observer-password-file observer.txt"
)
def ground(
    vehicle: Annotated[
        list[str] | None, typer.Option(help="NAME, or NAME@ENDPOINT; give it again for several vehicles.")
    ] = None,
    connect: Annotated[str, typer.Option(help="The endpoint of each vehicle named without one.")] = DEFAULT_CONNECT,
    identity: Identity = None,
    autopilot: Annotated[
        list[str] | None,
        typer.Option(
            help="Listen to the autopilot's own telemetry radio, read only: udpin:0.0.0.0:14550 or /dev/ttyUSB0,57600; "
            "NAME@… for one of several vehicles."
        ),
    ] = None,
    host: Host = "127.0.0.1",
    port: Port = 8080,
    token_file: TokenFile = None,
    certificate: CertificateFile = None,
    key: KeyFile = None,
    operator_password_file: OperatorPassword = None,
    observer_password_file: ObserverPassword = None,
    as_json: Json = False,
) -> None:
    """Serve the live dashboard until Ctrl-C. Space in it stops the vehicle shown, shift + space twice all.

    The printed link lets a browser in to command, the observers' link to see. Other machines log in over HTTPS.
    """
    from goshawk_ground.commands import admission  # viser takes a second to import: only where it is used
    from goshawk_ground.link import fleet
    from goshawk_ground.pages.serve import serve_dashboard

    with ExitStack() as stack:
        try:
            endpoints = fleet.places(vehicle or [DEFAULT_VEHICLE], connect)
            sources = fleet.radio_sources(autopilot or [], list(endpoints))
            links, radios = fleet.open_all(stack, endpoints, sources, identity, state_folder())
        except LinkError as error:
            fail(str(error), NO_REPLY)
        files = admission.Secrets(
            certificate=certificate,
            key=key,
            token=token_file,
            operator_password=operator_password_file,
            observer_password=observer_password_file,
        )
        with admission.failing_in_one_line():
            admitted = admission.admit(host, files)
            dashboard = serve_dashboard(
                *links, host=host, port=port, radios=radios, access=admitted.access, tls=admitted.tls
            )
        if as_json:
            facts = {"url": dashboard.url, "observer_url": dashboard.observer_url, "vehicles": endpoints}
            typer.echo(json.dumps({**facts, **admitted.facts()}))
        else:
            words = ", ".join(f"'{name}' at {endpoint}" for name, endpoint in endpoints.items())
            typer.echo(f"dashboard: {dashboard.url}  ({words}; Ctrl-C ends)")
            typer.echo("\n".join((f"observers: {dashboard.observer_url}", *admitted.words(port))))
        wait_for_interrupt()
        dashboard.close()
        for link in links:
            _say_if_pending(link)


def _say_if_pending(link: GroundLink) -> None:
    """Whoever ends the ground station must know that a Stop did not arrive."""
    stop = link.snapshot().stop
    if stop is not None and not stop.lapsed:
        words = f"goshawk: {link.vehicle}: {link.why_undelivered()} The next `goshawk ground` sends it again"
        typer.echo(f"{words} within {RESUME_S / 60.0:.0f} minutes.", err=True)


@app.command(
    epilog="Examples: goshawk demo | goshawk demo --seed 7 --speed 4 | goshawk demo --headless --json out.json"
)
def demo(
    seed: Annotated[int, typer.Option(min=0, help="Forest and runner.")] = 1,
    headless: Annotated[
        bool, typer.Option("--headless", help="Do not wait at the end; the exit status tells.")
    ] = False,
    speed: Annotated[float, typer.Option(min=0.5, help="The runner's speed, m/s.")] = 3.0,
    spacing: Annotated[float, typer.Option(min=1.0, help="Mean distance between trees, m.")] = 5.0,
    distance: Annotated[float, typer.Option(min=5.0, help="How far the runner runs, m.")] = 40.0,
    port: Port = 8080,
    bin_dir: BinDir = Path("target/release"),
    log_dir: Annotated[Path, typer.Option(help="Flight log and the processes' output.")] = Path("logs"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the summary to this file.")] = None,
) -> None:
    """Fly: simulator, vehicle and ground station chase a runner through a forest. Exit status 0 only on success."""
    from goshawk_ground.demo.run import DemoError, DemoOptions, run_demo

    options = DemoOptions(
        seed=seed,
        headless=headless,
        speed_mps=speed,
        spacing_m=spacing,
        distance_m=distance,
        port=port,
        bin_dir=bin_dir,
        log_dir=log_dir,
        json_file=json_file,
    )
    try:
        succeeded = run_demo(options)
    except DemoError as error:
        fail(str(error), REFUSED)
    raise typer.Exit(0 if succeeded else REFUSED)


@app.command(
    epilog="Examples: goshawk review logs/goshawk-2026-05-01T093000123Z.mcap | "
    "goshawk review before.mcap after.mcap | goshawk review flight.mcap --replay other-policy.mcap | "
    "goshawk review flight.mcap --host 0.0.0.0"
)
def review(
    logs: Annotated[list[Path], typer.Argument(help="A flight log, or two to compare; also one that was cut off.")],
    replay: Annotated[
        Path | None, typer.Option(help="What another policy made of it: a log that goshawk-air replay wrote.")
    ] = None,
    host: Host = "127.0.0.1",
    port: Port = 8080,
    token_file: TokenFile = None,
    certificate: CertificateFile = None,
    key: KeyFile = None,
    operator_password_file: OperatorPassword = None,
) -> None:
    """Serve recorded flights on a timeline until Ctrl-C: scrub, play, step, jump, compare."""
    from goshawk_ground.commands import admission  # viser takes a second to import: only where it is used
    from goshawk_ground.pages.review import LogError, open_review

    files = admission.Secrets(
        certificate=certificate, key=key, token=token_file, operator_password=operator_password_file
    )
    with admission.failing_in_one_line():
        admitted = admission.admit(host, files)
        try:
            dashboard = open_review(logs, replay, host=host, port=port, access=admitted.access, tls=admitted.tls)
        except LogError as error:
            fail(str(error), REFUSED)
    typer.echo(f"review: {dashboard.url}  ({', '.join(log.name for log in logs)}; Ctrl-C ends)")
    for line in admitted.words(port):
        typer.echo(line)
    wait_for_interrupt()
    dashboard.close()


logs.register(app)
doctor.register(app)
keys_transfer.register(app)
trainer.register(app)


def main() -> None:
    """Entry point."""
    app(prog_name="goshawk", obj=trainer.restart_with)
