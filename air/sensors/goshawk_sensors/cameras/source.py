"""What every camera looks like to the rest: a rig of two lenses, and frames until it is gone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from goshawk_sensors.cameras.clock import Stamp
from goshawk_sensors.view.pinhole import Rig
from goshawk_sensors.view.resample import Colour, Millimetres


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A pair of images as the camera took them. Its arrays live as long as it does."""

    colour_HW3: Colour
    depth_HW: Millimetres
    """In the rig's steps; 0: not measured."""
    stamp: Stamp
    arrival_ns: int
    """When this process got it, CLOCK_MONOTONIC."""
    number: int
    """The camera's count: a gap is what was lost on the way."""


class Source(Protocol):
    """An open camera, or a recording."""

    name: str
    """For people: model and serial number, or a file."""
    rig: Rig

    def read(self) -> Frame | None:
        """The next pair; None: none has come for a moment.

        Raises NoCameraError if it is gone, EndOfRecordingError after a recording's last pair.
        """
        ...

    def close(self) -> None:
        """Safe to call twice."""
        ...
