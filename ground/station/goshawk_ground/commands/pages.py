"""The commands that serve a page: `ground`, `demo`, `review`."""

from __future__ import annotations

import enum
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from goshawk_ground.commands.options import (
    NO_REPLY,
    REFUSED,
    BinDir,
    CertificateFile,
    Host,
    Identity,
    Json,
    KeyFile,
    ObserverPassword,
    OperatorPassword,
    Port,
    TokenFile,
    fail,
    newest_of_each,
    print_json,
)
from goshawk_ground.demo import places
from goshawk_ground.link import DEFAULT_CONNECT, DEFAULT_VEHICLE, GroundLink, LinkError
from goshawk_ground.orders.stop_file import state_folder
from goshawk_ground.orders.stop_latch import RESUME_S
from goshawk_ground.process.interrupt import until_interrupted


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
    foxglove: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=65535,
            metavar="PORT",
            help="Serve Foxglove's WebSocket too, such as 8765, to this computer only; each further vehicle one above.",
        ),
    ] = None,
    rerun: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Send to a Rerun viewer that runs already: rerun+http://127.0.0.1:9876/proxy."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Serve the live dashboard until Ctrl-C. Space in it stops the vehicle shown, shift + space twice all.

    The printed link lets a browser in to command, the observers' link to see. Other machines log in over HTTPS.
    """
    from goshawk_ground.commands import admission  # viser takes a second to import: only where it is used
    from goshawk_ground.link import fleet
    from goshawk_ground.pages.serve import serve_dashboard
    from goshawk_ground.pages.tools import foxglove_feeds, rerun_feeds

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
            tools = {} if foxglove is None else foxglove_feeds(links, foxglove)
            viewers = [] if rerun is None else rerun_feeds(links, rerun)
            for feed in (*tools.values(), *viewers):
                stack.enter_context(feed)
            dashboard = serve_dashboard(
                *links, host=host, port=port, radios=radios, access=admitted.access, tls=admitted.tls
            )
        with until_interrupted():
            if as_json:
                facts = {"url": dashboard.url, "observer_url": dashboard.observer_url, "vehicles": endpoints}
                print_json({**facts, "foxglove": list(tools), **admitted.facts()})
            else:
                words = ", ".join(f"'{name}' at {endpoint}" for name, endpoint in endpoints.items())
                typer.echo(f"dashboard: {dashboard.url}  ({words}; Ctrl-C ends)")
                typer.echo("\n".join((f"observers: {dashboard.observer_url}", *admitted.words(port))))
                for address in tools:
                    typer.echo(f"foxglove: {address}  (Open connection → Foxglove WebSocket, on this computer)")
        dashboard.close()
        for link in links:
            say_if_pending(link)


def say_if_pending(link: GroundLink) -> None:
    """Whoever ends the ground station must know that a Stop did not arrive."""
    stop = link.snapshot().stop
    if stop is not None and not stop.lapsed:
        left_s = RESUME_S - stop.age_s
        if stop.trouble:
            then = f"The next `goshawk ground` does not know of it: {stop.trouble}."
        elif left_s <= 0.0:
            then = "It is too old for the next `goshawk ground` to send it again."
        else:
            then = (
                f"The next `goshawk ground` sends it again if it starts within {max(left_s / 60.0, 1.0):.0f} minutes."
            )
        typer.echo(f"goshawk: {link.vehicle}: {link.why_undelivered()} {then}", err=True)


class DemoTask(enum.Enum):
    """What the demo flies."""

    TRACK = "track"
    NAVIGATE = "navigate"


def demo(
    seed: Annotated[int, typer.Option(min=0, help="Forest and target.")] = 1,
    headless: Annotated[
        bool, typer.Option("--headless", help="Do not wait at the end; the exit status tells.")
    ] = False,
    task: Annotated[DemoTask, typer.Option(help="Chase somebody, or fly to a goal.")] = DemoTask.TRACK,
    speed: Annotated[float | None, typer.Option(min=0.5, help="The target's speed, m/s; absent: 3.")] = None,
    spacing: Annotated[float, typer.Option(min=1.0, help="Mean distance between trees, m.")] = 5.0,
    distance: Annotated[
        float | None, typer.Option(min=5.0, help="How far the target runs, m; absent: 90, headless 40.")
    ] = None,
    port: Port = 8080,
    bin_dir: BinDir = None,
    log_dir: Annotated[Path, typer.Option(help="Flight log and the processes' output.")] = Path("logs"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the summary to this file.")] = None,
    px4: Annotated[Path | None, typer.Option(help="Fly by your PX4: its source tree, or its build.")] = None,
    ardupilot: Annotated[Path | None, typer.Option(help="Fly by your ArduPilot Copter, likewise.")] = None,
) -> None:
    """Fly: simulator, vehicle and ground station chase a target through a forest, or fly to a goal. Exit status 0 only
    on success."""
    from goshawk_ground.demo.run import DemoError, DemoOptions, run_demo

    navigate = task is DemoTask.NAVIGATE
    if navigate and (speed is not None or distance is not None or ardupilot is not None):
        fail(
            "--task navigate: leave out --speed, --distance and --ardupilot; navigate.toml says where and how", REFUSED
        )
    options = DemoOptions(
        seed=seed,
        navigate=navigate,
        headless=headless,
        speed_mps=speed or 3.0,
        spacing_m=spacing,
        distance_m=distance or (40.0 if headless else 90.0),
        port=port,
        bin_dir=bin_dir or places.programs(),
        log_dir=log_dir,
        json_file=json_file,
        px4=px4,
        ardupilot=ardupilot,
    )
    if px4 is not None and ardupilot is not None:
        fail("--px4 and --ardupilot: one of them flies", REFUSED)
    try:
        succeeded = run_demo(options)
    except DemoError as error:
        fail(str(error), REFUSED)
    raise typer.Exit(0 if succeeded else REFUSED)


def review(
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="Flight logs, up to six to compare; also one that was cut off; of a folder the newest.",
            callback=newest_of_each,
        ),
    ],
    replay: Annotated[
        Path | None, typer.Option(help="What another policy made of it: a log that goshawk-air replay wrote.")
    ] = None,
    policy: Annotated[
        list[Path] | None, typer.Option(help="A policy (.onnx) to plan again with, beside the shipped ones.")
    ] = None,
    beside: Annotated[
        Path | None, typer.Option(help="The autopilot's own log of the first flight: PX4's ULog, or a tlog.")
    ] = None,
    bin_dir: BinDir = None,
    host: Host = "127.0.0.1",
    port: Port = 8080,
    token_file: TokenFile = None,
    certificate: CertificateFile = None,
    key: KeyFile = None,
    operator_password_file: OperatorPassword = None,
) -> None:
    """Serve recorded flights on a timeline until Ctrl-C: charts of any signal, play, step, compare, plan again."""
    from goshawk_dashboards.log.progress import progress_bar

    from goshawk_ground.commands import admission  # viser takes a second to import: only where it is used
    from goshawk_ground.pages.replan import replanner_of
    from goshawk_ground.pages.review import BesideError, LogError, open_review

    files = admission.Secrets(
        certificate=certificate, key=key, token=token_file, operator_password=operator_password_file
    )
    with admission.failing_in_one_line():
        admitted = admission.admit(host, files)
        try:
            replanner = replanner_of(bin_dir or places.programs(), [*places.policies(), *(policy or [])])
            with progress_bar(counted=False) as progress:
                dashboard = open_review(
                    logs,
                    replay,
                    host=host,
                    port=port,
                    access=admitted.access,
                    tls=admitted.tls,
                    replanner=replanner,
                    beside=beside,
                    progress=progress,
                )
        except (BesideError, LogError) as error:
            fail(str(error), NO_REPLY)
    with until_interrupted():
        typer.echo(f"review: {dashboard.url}  ({', '.join(log.name for log in logs)}; Ctrl-C ends)")
        if dashboard.beside is not None:
            typer.echo(dashboard.beside.words)
        for line in admitted.words(port):
            typer.echo(line)
    dashboard.close()


def register(app: typer.Typer) -> None:
    """Adds the commands to the `goshawk` command."""
    app.command(
        epilog="Examples: goshawk ground | goshawk ground --vehicle hawk@tls/192.168.1.7:7447 "
        "--autopilot udpin:0.0.0.0:14550 | "
        "goshawk ground --vehicle alpha@tls/192.168.1.7:7447 --vehicle bravo@tls/192.168.1.8:7447 | "
        "goshawk ground --host 0.0.0.0 --operator-password-file operator.txt --observer-password-file observer.txt"
    )(ground)
    app.command(
        epilog="Examples: goshawk demo | goshawk demo --seed 7 --speed 4 | goshawk demo --task navigate | "
        "goshawk demo --headless --json out.json"
    )(demo)
    app.command(
        epilog="Examples: goshawk review logs/goshawk-2026-05-01T093000123Z.mcap | "
        "goshawk review before.mcap after.mcap third.mcap | goshawk review flight.mcap --replay other-policy.mcap | "
        "goshawk review flight.mcap --policy runs/flown.onnx | goshawk review flight.mcap --beside flight.ulg | "
        "goshawk review flight.mcap --host 0.0.0.0"
    )(review)
