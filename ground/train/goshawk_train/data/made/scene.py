"""Makes one scene, wherever that is: it needs Python's own library and the simulator. Ray carries this file to its
nodes."""

from __future__ import annotations

import os
import subprocess
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Files = dict[str, bytes]
"""What a scene's folder holds, by the files' names."""


class SceneError(Exception):
    """The simulator would not; the message is its own last line."""


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Everything that decides a data set."""

    scenes: int
    frames: int
    seed: int
    simulator_sha256: str

    def arguments(self, out: Path, first: int, end: int) -> list[str]:
        """For `goshawk-sim`: the scenes from `first` to before `end`."""
        size = ["--scenes", str(self.scenes), "--frames", str(self.frames), "--seed", str(self.seed)]
        return ["dataset", "--out", str(out), *size, "--threads", "1", "--only", f"{first}..{end}"]


@dataclass(kw_only=True)
class Makers:
    """The simulators that run in this process's care."""

    running: set[subprocess.Popen[bytes]] = field(default_factory=set[subprocess.Popen[bytes]])
    ended: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock)

    def make(self, simulator: Path, recipe: Recipe, scene: int) -> Files:
        """One scene's files; raises `SceneError`."""
        with tempfile.TemporaryDirectory(prefix="goshawk-scene-") as folder:
            self.run([str(simulator), *recipe.arguments(Path(folder), scene, scene + 1)])
            made = Path(folder) / f"scene_{scene:04d}"
            return {path.name: path.read_bytes() for path in made.iterdir()}

    def run(self, command: list[str]) -> None:
        """The simulator, to its end; raises `SceneError`."""
        with self.lock:
            if self.ended:
                raise SceneError("ended")
            # A session of its own: Ctrl-C is the driver's, which ends it in order.
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)
            self.running.add(child)
        _, words = child.communicate()
        self.running.discard(child)
        if child.returncode:
            last = words.decode(errors="replace").strip().splitlines()[-1:] or [f"status {child.returncode}"]
            raise SceneError(f"goshawk-sim dataset: {last[0]}")

    def end(self) -> None:
        """Ends what runs; nothing more begins."""
        with self.lock:
            self.ended = True
            for child in self.running:
                child.kill()


def make_on_node(program: list[Any], recipe: Recipe, scene: int) -> Files:
    """A scene in a process of a Ray node. `program` holds the reference to the simulator, which comes once a node."""
    place = Path(tempfile.gettempdir()) / f"goshawk-sim-{os.getuid()}-{recipe.simulator_sha256[:16]}"
    if not place.is_file():
        import ray as typeless

        library: Any = typeless
        with tempfile.NamedTemporaryFile(dir=place.parent, delete=False) as partial:
            partial.write(library.get(program[0]))
        Path(partial.name).chmod(0o700)
        Path(partial.name).replace(place)
    return Makers().make(place, recipe, scene)
