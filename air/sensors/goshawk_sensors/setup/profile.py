"""A camera's profile: what it is asked for, in a TOML file of ours or yours. An unknown key is an error."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from goshawk_sensors.setup.errors import CameraError

Side = Annotated[int, Meta(ge=16, le=4096)]
Align = Literal["colour", "depth"]


class Image(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One of the two images as the camera delivers it."""

    size: tuple[Side, Side]
    """Width and height, pixels: a mode of the camera."""
    auto_exposure: bool = False
    """False, and no exposure_us either: as the camera is."""
    exposure_us: Annotated[int, Meta(ge=1, le=200_000)] | None = None
    """A fixed one, in place of the automatic one."""

    def __post_init__(self) -> None:
        if self.auto_exposure and self.exposure_us is not None:
            raise ValueError("say either auto_exposure = true or exposure_us, not both")


class Depth(Image, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The depth image."""

    clip_m: tuple[Annotated[float, Meta(ge=0.0)], Annotated[float, Meta(le=65.0)]]
    """What is nearer or farther counts as not measured."""
    preset: str | None = None
    """A visual preset by librealsense's name; absent: as the camera is."""
    emitter: bool | None = None
    """The infrared projector; absent: as the camera is."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.clip_m[0] >= self.clip_m[1]:
            raise ValueError("clip_m is nearest, farthest")


class Profile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A whole profile."""

    driver: Literal["realsense", "oak"]
    rate_hz: Annotated[int, Meta(ge=5, le=90)]
    align: Align
    """Whose view goes out; the other image is brought onto it."""
    rim: bool = False
    """Whether a colour lens that sees less than the policy wants is taken: beyond it the colour repeats its border.
    Goes with align = "colour" alone."""
    latency_ms: Annotated[float, Meta(ge=0.0, le=200.0)]
    """From the middle of the exposure to its arrival here, where the camera does not tell."""
    depth: Depth
    colour: Image

    def __post_init__(self) -> None:
        if self.rim and self.align != "colour":
            raise ValueError('rim = true is for align = "colour"')


def shipped() -> list[str]:
    """The names of the profiles that come with this package."""
    return sorted(entry.name.removesuffix(".toml") for entry in (files("goshawk_sensors") / "profiles").iterdir())


def load(name: str) -> Profile:
    """A shipped profile by its name, or a file. Raises CameraError: one line that names file and key."""
    if "\0" in name:  # no file has such a name, and no terminal shows it
        raise CameraError(f"the profile's name {name!r} has a NUL character: take it out")
    path = Path(str(files("goshawk_sensors") / f"profiles/{name}.toml")) if name in shipped() else Path(name)
    try:
        return msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), Profile)
    except FileNotFoundError:
        raise CameraError(f"no profile '{name}': name a file, or one of {', '.join(shipped())}") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise CameraError(f"profile {path}: {error}") from error
