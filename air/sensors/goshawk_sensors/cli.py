"""The `goshawk-camera` command line. Exit status: 0 done, 1 camera or set-up are not fit to fly, 2 wrong usage."""

from __future__ import annotations

import functools
import math
import signal
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from goshawk_sensors import keeping, tally
from goshawk_sensors.cameras.recorder import Recorder
from goshawk_sensors.keeping import Opening
from goshawk_sensors.setup import address, profile, vehicle
from goshawk_sensors.setup.errors import CameraError, RecordingError

TELL_S = 10.0
"""How often `run` says how it goes."""
LEAST_RATE, LEAST_MEASURED = 0.9, 0.2
"""What `check` asks for: of the profile's rate, and of the pixels, with a depth (as goshawk-air check does)."""

app = typer.Typer(
    name="goshawk-camera",
    help="Feed the vehicle with a camera's images, as its policy wants them.",
    epilog="Typical: goshawk-camera check --config vehicle.toml --profile d455, then run with the same words.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

Config = Annotated[Path, typer.Option("--config", help="The vehicle file: whom to feed, and with which policy.")]
ProfileName = Annotated[
    str,
    typer.Option(
        "--profile", metavar="NAME", help=f"A file, or one of {', '.join(profile.shipped())} (oak-d: UNTRIED)."
    ),
]
Serial = Annotated[str | None, typer.Option(help="The camera's serial number; absent: the only one.")]
Play = Annotated[
    Path | None, typer.Option(help="A recording by librealsense or --record, in place of a camera, stamped as if live.")
]


@app.command("list")
def list_cameras() -> None:
    """The cameras that are plugged in, and the profiles. Exit status 1 if there is no camera.

    Example: goshawk-camera list
    """
    typer.echo(f"profiles: {', '.join(profile.shipped())}")
    with told():
        from goshawk_sensors.cameras import realsense

        found = [realsense.describe(device) for device in realsense.cameras()]
    for name in found:
        typer.echo(name)
    if not found:
        fail("no RealSense is plugged in: see its cable and USB 3 port; an OAK-D is not listed")


@app.command()
def run(
    config: Config,
    profile_name: ProfileName = "d455",
    serial: Serial = None,
    play: Play = None,
    loop: Annotated[bool, typer.Option("--loop", help="Play the recording again and again.")] = False,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE.db3", help="Keep all that the camera sends, for --play.")
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait for a camera that is not there yet.")] = False,
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Where the vehicle listens; absent: as its file says.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="For how long; absent: until Ctrl-C.")] = None,
) -> None:
    """Send images until Ctrl-C. A camera that is unplugged is waited for; so is the vehicle.

    Examples: goshawk-camera run --config vehicle.toml --profile d455

    goshawk-camera run --config vehicle.toml --play flight.db3 --loop
    """
    with told(), interrupted() as ending:
        from goshawk_sensors.feed import Images, publisher

        chosen, fed = profile.load(profile_name), vehicle.load(config)
        endpoint = address.checked(fed.endpoint if connect is None else connect)
        recorder = None if record is None else Recorder(record, say)
        images, opening = Images(fed.wanted, chosen), _opening(chosen, serial, play, recorder)
        first = keeping.begun(opening, ending, say, wait=wait)
        if first is not None:
            images.of(first)  # its tables take longer than an image lasts
        with publisher(fed.name, endpoint, ending, say) as sending:
            told_s = begun_s = time.monotonic()
            said, sent, total = set[tuple[str, str]](), tally.Tally(), 0
            until_s = math.inf if seconds is None else begun_s + seconds
            for source, frame in keeping.frames(first, opening, ending, say, loop=loop, until_s=until_s):
                message, depth_mm = images.message(source, frame)
                if sending is not None:  # else Ctrl-C came first, and so this ends
                    sending.put(message.SerializeToString())
                sent.take(frame, depth_mm)
                total += 1
                if (source.name, frame.stamp.source) not in said:
                    said.add((source.name, frame.stamp.source))
                    say(f"{source.name}: {tally.view(images.of(source))}; stamped by {frame.stamp.source}")
                now_s = time.monotonic()
                if now_s - told_s >= TELL_S:
                    typer.echo(sent.line())
                    told_s, sent = now_s, tally.Tally()
            if sent.count:
                typer.echo(sent.line())
            typer.echo(f"{total} images sent")
        if recorder is not None and recorder.incomplete is not None:
            fail(recorder.incomplete)


@app.command()
def check(
    config: Config,
    profile_name: ProfileName = "d455",
    serial: Serial = None,
    play: Play = None,
    seconds: Annotated[float, typer.Option(min=0.5, help="For how long to look.")] = 3.0,
) -> None:
    """Look at the camera, send nothing, and say what it is worth. Exit status 1 if it is not fit to fly.

    Example: goshawk-camera check --config vehicle.toml --profile d455
    """
    with told(), interrupted() as ending:
        from goshawk_sensors.feed import Images

        chosen, fed = profile.load(profile_name), vehicle.load(config)
        images, seen = Images(fed.wanted, chosen), tally.Tally()
        begun_s: float | None = None
        opening = _opening(chosen, serial, play, None)
        first = opening()
        images.of(first)
        for source, frame in keeping.frames(first, opening, ending, say, again=False):
            if begun_s is None:
                typer.echo(f"{'camera':14}{source.name}")
                typer.echo(f"{'view':14}{tally.view(images.of(source))}")
                begun_s = time.monotonic()
            seen.take(frame, images.message(source, frame)[1])
            if time.monotonic() - begun_s >= seconds:
                break
        if not seen.count:
            fail("no image came")
        typer.echo(f"{'rate':14}{seen.rate_hz:.1f} Hz, {chosen.rate_hz} are asked for")
        typer.echo(f"{'lost':14}{seen.lost} of {seen.count + seen.lost}")
        typer.echo(f"{'latency':14}{seen.latency}")
        typer.echo(f"{'depth':14}{seen.measured:.0%} of the pixels")
        typer.echo(f"{'stamp':14}{seen.stamp_source}")
        if seen.rate_hz < LEAST_RATE * chosen.rate_hz:
            fail(f"{seen.rate_hz:.1f} Hz are too few: use a USB 3 port and cable, or ask for a smaller image")
        if seen.measured < LEAST_MEASURED:
            fail(f"{seen.measured:.0%} with depth are too few: point it at something, clean the lenses")


def say(text: str) -> None:
    """One line to the person who started it."""
    typer.echo(f"goshawk-camera: {text}", err=True)


def fail(text: str) -> NoReturn:
    """Ends with one line."""
    say(text)
    raise typer.Exit(1)


@contextmanager
def told() -> Generator[None]:
    """A CameraError becomes one line and status 1."""
    try:
        yield
    except CameraError as error:
        fail(str(error))


@contextmanager
def interrupted() -> Generator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set."""
    ending = threading.Event()

    def end(*_: object) -> None:
        ending.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    yield ending


def _opening(chosen: profile.Profile, serial: str | None, play: Path | None, recorder: Recorder | None) -> Opening:
    """How the camera is opened, as often as it must be. What drives it is imported here: `--help` needs none of it."""
    if play is not None:
        if recorder is not None:
            raise CameraError("a recording is not recorded again: leave out --play or --record")
        from goshawk_sensors.cameras import realsense

        return functools.partial(realsense.open_recording, play, chosen)
    if chosen.driver == "oak":
        from goshawk_sensors.cameras import oak

        if recorder is not None:
            raise CameraError("an OAK-D is not recorded: leave out --record")
        return functools.partial(oak.open_live, chosen, serial)
    from goshawk_sensors.cameras import realsense

    if recorder is None:
        return functools.partial(realsense.open_live, chosen, serial, None)

    def open_live() -> realsense.RealSense:
        # Whoever starts again, or a camera that comes back, begins a file of its own: no recording is overwritten.
        file = recorder.next_file()
        try:
            return realsense.open_live(chosen, serial, file)
        except RecordingError as error:
            if file is None or not recorder.begun:
                raise
            recorder.gave_up(file.path, "could not be begun", str(error))
            return realsense.open_live(chosen, serial, None)

    return open_live


def main() -> None:
    """Entry point."""
    app(prog_name="goshawk-camera")
