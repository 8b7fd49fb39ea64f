"""Which vehicles `goshawk ground` watches, and where: parsed from the command line."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from goshawk_ground.link.client import GroundLink
from goshawk_ground.link.dial import LinkError
from goshawk_ground.link.radio import Radio


def places(vehicles: Sequence[str], connect: str) -> dict[str, str]:
    """The endpoint of each vehicle, from NAME or NAME@ENDPOINT. Raises LinkError if a name comes twice."""
    found: dict[str, str] = {}
    for word in vehicles:
        name, at, endpoint = word.partition("@")
        if name in found:
            raise LinkError(f"vehicle '{name}' is named twice")
        found[name] = endpoint if at else connect
    return found


def radio_sources(autopilots: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """The radio of each vehicle that has one, from SOURCE (the first vehicle's) or NAME@SOURCE.

    Raises LinkError if a vehicle is not watched, or has two.
    """
    found: dict[str, str] = {}
    for word in autopilots:
        head, at, tail = word.partition("@")
        name, source = (head, tail) if at else (names[0], word)
        if name not in names:
            raise LinkError(f"--autopilot {word}: no vehicle '{name}' among {', '.join(names)}")
        if name in found:
            raise LinkError(f"vehicle '{name}' has two radios")
        found[name] = source
    return found


def open_all(
    stack: ExitStack,
    endpoints: dict[str, str],
    sources: dict[str, str],
    identity: Path | None = None,
    state: Path | None = None,
) -> tuple[list[GroundLink], dict[str, Radio]]:
    """Every link and radio, closed with the stack; ``state``: see GroundLink. Raises LinkError, naming the vehicle."""
    links: list[GroundLink] = []
    radios: dict[str, Radio] = {}
    for name, endpoint in endpoints.items():
        try:
            link = GroundLink(vehicle=name, connect=endpoint, identity=identity, state=state)
            links.append(stack.enter_context(link))
            if name in sources:
                radios[name] = stack.enter_context(Radio(sources[name]))
        except LinkError as error:
            raise LinkError(f"vehicle '{name}' at {endpoint}: {error}") from error
    return links, radios
