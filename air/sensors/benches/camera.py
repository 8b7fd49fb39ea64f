"""What `goshawk-camera` costs: its share of a core, and how much later an image is for it.

    PYTHONPATH=air/sensors/tests:ground/station/benches python air/sensors/benches/camera.py [--seconds 8]

librealsense's software device writes a recording of a D455: depth 848 x 480, colour 1280 x 800, 30 a second, noisy. It
is played twice, each time in a process of its own. The yardstick takes the pairs out of librealsense's pipeline and
does nothing with them; its cost is to read and unpack the file, which a live camera does not have. `goshawk-camera run`
does all that it does in flight. The difference is `camera_core_fraction`. An image's age is counted from its stamp
until it is here: out of the pipeline for the yardstick, out of Zenoh for the program.

`camera_added_ms` is measured by itself, for a file's unpacking takes cores from what follows: how long it takes from a
pair in hand to its image in another Zenoh session, 30 times a second. A machine that is busy with something else adds
to it; then the figure is printed and not recorded.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import zenoh
from common import free_port, record, verdict, waited_seconds
from goshawk_proto import goshawk_pb2, key_expression
from goshawk_sensors.cameras import realsense
from goshawk_sensors.cameras.clock import Stamp
from goshawk_sensors.cameras.source import Frame
from goshawk_sensors.feed import Images, publisher
from goshawk_sensors.setup import profile, vehicle
from goshawk_sensors.setup.errors import EndOfRecordingError
from goshawk_sensors.view.pinhole import Rig
from lenses import lens, rig
from software_camera import Shot, SoftwareCamera

TARGET_CORE, TARGET_MS = 0.15, 3.0
ROOT = Path(__file__).resolve().parents[3]
RATE_HZ, WARM_S = 30, 1.0
IDLE_MS = 0.5
"""A machine on which an image waits longer for a core says nothing of the latency: it is not recorded."""
VEHICLE = ROOT / "air/vehicles/sim.toml"


D455 = replace(rig(move_m=(-0.059, 0.0, 0.0)), colour=lens(1280, 800, 90.0, 65.0), depth=lens(848, 480, 87.0, 56.5))


@dataclass(kw_only=True)
class Still:
    """A source whose frames are at hand."""

    rig: Rig
    name: str = "at hand"

    def read(self) -> Frame | None:
        return None

    def close(self) -> None:
        return


@dataclass(frozen=True, kw_only=True)
class Found:
    """Of one process."""

    core: float
    ages: list[float]
    """Of each image, ms."""

    def late_ms(self) -> tuple[float, float]:
        """Median and 99th percentile of the ages, the first second aside."""
        p50, p99 = np.percentile(self.ages[round(WARM_S * RATE_HZ) :], [50, 99])
        return float(p50), float(p99)


def scene(seconds: float) -> Iterator[Shot]:
    """A leaning wall of blocks that drifts by, with a sensor's noise and holes."""
    rng = np.random.default_rng(1)
    blocks = rng.integers(0, 256, (120, 200, 3), dtype=np.uint8).repeat(8, axis=0).repeat(8, axis=1)
    depth = (2000 + 5 * np.arange(848) + rng.normal(0.0, 20.0, (480, 848))).astype(np.uint16)
    depth[rng.random(depth.shape) < 0.1] = 0
    begun_ms = time.time() * 1000.0
    for k in range(round(seconds * RATE_HZ)):
        colour = np.ascontiguousarray(blocks[k % 160 : k % 160 + 800, k % 160 : k % 160 + 1280])
        yield Shot(colour_HW3=colour, depth_HW=np.roll(depth, k, axis=1), wall_ms=begun_ms + k * 1000.0 / RATE_HZ)


def plain(file: Path) -> None:
    """The yardstick's process: prints its share of a core and each pair's age, ms, as JSON."""
    source, ages = realsense.open_recording(file, profile.load("d455")), list[float]()
    begun_s = cpu_s = core = 0.0
    try:
        while True:
            frame = source.read()
            if frame is None:
                continue
            ages.append(1e-6 * (frame.arrival_ns - frame.stamp.monotonic_ns))
            if len(ages) == round(WARM_S * RATE_HZ):
                begun_s, cpu_s = time.monotonic(), time.process_time()
            core = (time.process_time() - cpu_s) / max(1e-3, time.monotonic() - begun_s)
    except EndOfRecordingError:
        print(json.dumps({"core": core, "ages": ages}))
    source.close()


def listening(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in {"mode": "peer", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def fed(file: Path, seconds: float) -> Found:
    """The same of `goshawk-camera run`."""
    endpoint, ages, first = f"tcp/127.0.0.1:{free_port()}", list[float](), threading.Event()

    def take(sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        ages.append(1e-6 * (now_ns - goshawk_pb2.Rgbd.FromString(sample.payload.to_bytes()).stamp_ns))
        first.set()

    command = [sys.executable, "-c", "from goshawk_sensors.cli import main; main()", "run", "--config", str(VEHICLE)]
    with listening(endpoint) as session:
        subscriber = session.declare_subscriber(key_expression("rgbd", vehicle.load(VEHICLE).name), take)
        with subprocess.Popen([*command, "--play", str(file), "--connect", endpoint], stdout=subprocess.DEVNULL) as run:
            first.wait(30.0)
            time.sleep(WARM_S)
            begun_s, cpu_s = time.monotonic(), core_seconds(run.pid)
            time.sleep(seconds - 2.0 * WARM_S)
            core = (core_seconds(run.pid) - cpu_s) / (time.monotonic() - begun_s)
            run.wait()
        subscriber.undeclare()
    return Found(core=core, ages=ages)


def added_ms(seconds: float) -> tuple[list[float], float]:
    """From each pair in hand to its image in another session; and how long it waited for a core, on average."""
    endpoint, came_ns, taken = f"tcp/127.0.0.1:{free_port()}", list[int](), list[float]()
    chosen, wanted = profile.load("d455"), vehicle.load(VEHICLE)
    images, source = Images(wanted.wanted, chosen), Still(rig=D455)
    with listening(endpoint) as session, publisher(wanted.name, endpoint, threading.Event(), print) as sending:
        assert sending is not None
        key = key_expression("rgbd", wanted.name)
        subscriber = session.declare_subscriber(key, lambda _: came_ns.append(time.monotonic_ns()))
        before_s = waited_seconds(os.getpid())
        for number, shot in enumerate(scene(seconds)):
            time.sleep(1.0 / RATE_HZ)
            begun_ns, known = time.monotonic_ns(), len(came_ns)
            stamp = Stamp(monotonic_ns=begun_ns, source="")
            frame = Frame(
                colour_HW3=shot.colour_HW3, depth_HW=shot.depth_HW, stamp=stamp, arrival_ns=begun_ns, number=number
            )
            sending.put(images.message(source, frame)[0].SerializeToString())
            while len(came_ns) == known and time.monotonic_ns() < begun_ns + 1_000_000_000:
                time.sleep(0.0005)
            taken.append(1e-6 * (came_ns[-1] - begun_ns))
        waited_ms = 1000.0 * (waited_seconds(os.getpid()) - before_s) / len(taken)
        subscriber.undeclare()
    return taken, waited_ms


def core_seconds(pid: int) -> float:
    """Of a process, ended threads included."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=8.0, help="of the recording (default: %(default)s)")
    parser.add_argument("--plain", type=Path, help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.plain is not None:
        plain(words.plain)
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "d455.db3"
        print(f"recording {words.seconds:g} s", flush=True)
        SoftwareCamera(D455).record(file, scene(words.seconds))
        yardstick = Found(**json.loads(subprocess.check_output([sys.executable, __file__, "--plain", str(file)])))
        ours = fed(file, words.seconds)
    print(f"{'':24}{'core':>8}{'age p50':>10}{'p99, ms':>10}{'images':>8}")
    for name, found in (("plain librealsense", yardstick), ("goshawk-camera", ours)):
        print(f"{name:24}{found.core:8.1%}{found.late_ms()[0]:10.2f}{found.late_ms()[1]:10.2f}{len(found.ages):8}")
    core = ours.core - yardstick.core
    print(f"goshawk-camera adds {core:.1%} of a core (≤ {TARGET_CORE:.0%}: {verdict(core <= TARGET_CORE)})")
    record("camera_core_fraction", core)
    taken, waited_ms = added_ms(words.seconds)
    p50, p99 = np.percentile(taken[RATE_HZ:], [50, 99])
    print(f"a pair in hand is an image elsewhere after p50 {p50:.2f}, p99 {p99:.2f} ms (≤ {TARGET_MS:g}: ", end="")
    print(f"{verdict(p50 <= TARGET_MS)}); it waited {waited_ms:.2f} ms of it for a core, on average")
    if waited_ms <= IDLE_MS:
        record("camera_added_ms", float(p50))


if __name__ == "__main__":
    main()
