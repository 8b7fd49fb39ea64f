"""A kit: all files that decide a campaign's flights, in one folder that can be sent anywhere.

A file of it lies in a folder named by the hash of its content, so that arguments with such names say what is flown.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from goshawk_train.cluster.worker import PROGRAM
from goshawk_train.errors import TrainerError


class KitError(TrainerError):
    """A file that flights need cannot be had; the message says which."""


def sha256(content: bytes) -> str:
    """In hex."""
    return hashlib.sha256(content).hexdigest()


@dataclass(kw_only=True)
class Kit:
    """By their names in it: where the files are now."""

    simulator: Path
    files: dict[str, Path] = field(default_factory=dict[str, Path])
    scratch: Path
    """A folder for what is made for it."""

    @cached_property
    def program_sha256(self) -> str:
        """Of the simulator and the ONNX Runtime that it loads."""
        return sha256("".join(sha256(path.read_bytes()) for path in self._program.values()).encode())

    @cached_property
    def _program(self) -> dict[str, Path]:
        if not self.simulator.is_file():
            raise KitError(f"{self.simulator} is missing: build it with `make build`")
        found = importlib.util.find_spec("onnxruntime")
        places = [Path(place) / "capi" for place in (found and found.submodule_search_locations) or ()]
        library = [path for place in places for path in sorted(place.glob("libonnxruntime.so*"))]
        if not library:
            raise KitError("the package onnxruntime is missing: make setup")
        # The simulator looks beside itself first.
        return {PROGRAM: self.simulator, f"program/{library[-1].name}": library[-1]}

    @property
    def digest(self) -> str:
        """Of all of it."""
        return sha256("\n".join([self.program_sha256, *sorted(self.files)]).encode())

    def take(self, arguments: list[str]) -> list[str]:
        """Takes in the files that the arguments name; the arguments with their names in the kit."""
        return [
            self._vehicle(Path(value)) if option == "--vehicle-file" else ",".join(map(self._if_file, value.split(",")))
            for option, value in zip(["", *arguments], arguments, strict=False)
        ]

    def scan(self, options: list[str], seed: int) -> str:
        """A world's scan, made for the flights to take place in; its path."""
        cloud = self.scratch / sha256(repr((options, seed)).encode())[:12] / "scan.ply"
        cloud.parent.mkdir(parents=True, exist_ok=True)
        command = ["world", *options, "--seed", str(seed), "--scan", cloud, "--output", cloud.with_suffix(".png")]
        made = subprocess.run([self.simulator, *command], stdout=subprocess.DEVNULL, check=False)
        if made.returncode:
            raise KitError(f"the scan was not made: goshawk-sim world ended with {made.returncode}")
        return str(cloud)

    def bytes(self) -> dict[str, bytes]:
        """All contents, to be sent."""
        return {name: path.read_bytes() for name, path in {**self._program, **self.files}.items()}

    def unpack(self, folder: Path) -> Path:
        """Its files in a folder of this machine."""
        for name, path in {**self._program, **self.files}.items():
            place = folder / name
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place)
        return folder

    def _if_file(self, value: str) -> str:
        path = Path(value)
        if "." not in value or not path.is_file():
            return value
        return self._add(path, sha256(path.read_bytes()))

    def _add(self, path: Path, digest: str) -> str:
        name = f"files/{digest}/{path.name}"
        self.files[name] = path
        return name

    def _vehicle(self, path: Path) -> str:
        """A vehicle file and the tuning file beside it, which it names."""
        try:
            text = path.read_text()
            named = re.search(r'^tuning = "([^"/]+)"', text, re.MULTILINE)
            if named is None:
                raise KitError(f"{path} names no tuning file that lies beside it")
            tuning = path.parent / named[1]
            digest = sha256(f"{text}\0{tuning.read_text()}".encode())
        except OSError as error:
            raise KitError(f"cannot read {error.filename}: {error.strerror}") from error
        self._add(tuning, digest)
        return self._add(path, digest)


def temporary() -> tempfile.TemporaryDirectory[str]:
    """For a kit's making and for its files."""
    return tempfile.TemporaryDirectory(prefix="goshawk-kit-")
