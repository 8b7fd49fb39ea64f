"""What the vehicle asks of its camera: read from the vehicle file and the policy that it names, not said twice."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from goshawk_sensors.setup.errors import CameraError

CONTRACT = "goshawk_contract"
"""The key of an ONNX file's metadata that says what the policy was trained with."""


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """The image that goes out: a pinhole's, its axis in the middle."""

    width: int
    height: int
    hfov_rad: float
    vfov_rad: float


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Who the camera feeds."""

    name: str
    endpoint: str
    """Where it listens to its sensors."""
    wanted: Wanted


class _Policy(msgspec.Struct):
    model: str


class _Network(msgspec.Struct):
    listen: list[str]


class _File(msgspec.Struct):
    """What is read of a vehicle file."""

    name: str
    policy: _Policy
    network: _Network


def load(path: Path) -> Vehicle:
    """Raises CameraError if the file or its policy cannot be read, or says nothing of an image."""
    if "\0" in str(path):
        raise CameraError(f"the vehicle file's name {str(path)!r} has a NUL character: take it out")
    try:
        facts = msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), _File)
    except OSError as error:
        raise CameraError(f"vehicle file {path}: {error.strerror}") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise CameraError(f"vehicle file {path}: {error}") from error
    except msgspec.ValidationError as error:
        raise CameraError(f"vehicle file {path}: {error}; goshawk-air check says what it needs") from error
    if "\0" in facts.policy.model:
        raise CameraError(f"vehicle file {path}: the policy's name {facts.policy.model!r} has a NUL character")
    return Vehicle(
        name=facts.name, endpoint=endpoint(facts.network.listen), wanted=_wanted(path.parent / facts.policy.model)
    )


def endpoint(listen: list[str]) -> str:
    """Of those that the vehicle listens on, the one for its sensors: its socket, or its TCP port by way of this host.

    Raises CameraError if neither is there.
    """
    for protocol in ("unixsock-stream/", "tcp/"):
        for each in listen:
            if each.startswith(protocol):
                return each.replace("tcp/0.0.0.0:", "tcp/127.0.0.1:").replace("tcp/[::]:", "tcp/[::1]:")
    raise CameraError('the vehicle listens to no sensor: add "unixsock-stream//run/goshawk/sensors.sock" to its listen')


def _wanted(model: Path) -> Wanted:
    import onnxruntime as ort  # half a second that `list` need not wait

    if not model.is_file():
        raise CameraError(f"the vehicle file's policy {model} is not there")
    try:
        session: Any = ort.InferenceSession(str(model), providers=["CPUExecutionProvider"])
        return Wanted(**json.loads(session.get_modelmeta().custom_metadata_map[CONTRACT])["image"])
    except KeyError as error:
        raise CameraError(f"policy {model} has no {CONTRACT}: export it with goshawk train export") from error
    except Exception as error:  # onnxruntime raises whatever it likes for a file that is missing or no model
        raise CameraError(f"policy {model}: {' '.join(str(error).split())}") from error
