"""What `goshawk-camera` costs: its share of a core, and how much later an image is for it.

    PYTHONPATH=air/sensors/tests:ground/station/benches python air/sensors/benches/camera.py [--seconds 8]

librealsense's software device writes a recording of a D455: depth 848 x 480, colour 1280 x 800, 30 a second, noisy. It
is played twice, each time in a process of its own. The yardstick takes the pairs out of librealsense's pipeline and
does nothing with them; its cost is to read and unpack the file, which a live camera does not have. `goshawk-camera run`
does all that it does in flight, and a Zenoh session here takes what it sends. An image's age is counted from its stamp
until it is here: out of the pipeline for the yardstick, out of Zenoh for the program. The difference is what
`goshawk-camera` adds. The keys: `camera_core_fraction` and `camera_added_ms`, with the yardstick's taken off.
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
from goshawk_sensors.setup import profile, vehicle
from goshawk_sensors.setup.errors import EndOfRecordingError
from software_camera import Shot, SoftwareCamera, lens, rig

TARGET_CORE, TARGET_MS = 0.15, 3.0
ROOT = Path(__file__).resolve().parents[3]
RATE_HZ, WARM_S = 30, 1.0
IDLE_MS = 0.5
"""A machine on which an image waits longer for a core says nothing of the latency: it is not recorded."""
VEHICLE = ROOT / "air/vehicles/sim.toml"


@dataclass(frozen=True, kw_only=True)
class Found:
    """Of one process."""

    core: float
    ages: list[float]
    """Of each image, ms."""
    waited_ms: float = 0.0
    """For each image, for a core."""

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


def fed(file: Path, seconds: float) -> Found:
    """The same of `goshawk-camera run`."""
    endpoint, ages, first = f"tcp/127.0.0.1:{free_port()}", list[float](), threading.Event()
    config = zenoh.Config()
    for key, value in {"mode": "peer", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))

    def take(sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        ages.append(1e-6 * (now_ns - goshawk_pb2.Rgbd.FromString(sample.payload.to_bytes()).stamp_ns))
        first.set()

    command = [sys.executable, "-c", "from goshawk_sensors.cli import main; main()", "run", "--config", str(VEHICLE)]
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(key_expression("rgbd", vehicle.load(VEHICLE).name), take)
        with subprocess.Popen([*command, "--play", str(file), "--connect", endpoint], stdout=subprocess.DEVNULL) as run:
            first.wait(30.0)
            time.sleep(WARM_S)
            begun_s, cpu_s, waited_s = time.monotonic(), core_seconds(run.pid), waited_seconds(run.pid)
            time.sleep(seconds - 2.0 * WARM_S)
            span_s = time.monotonic() - begun_s
            core, waited = (core_seconds(run.pid) - cpu_s) / span_s, (waited_seconds(run.pid) - waited_s) / span_s
            run.wait()
        subscriber.undeclare()
    return Found(core=core, ages=ages, waited_ms=1000.0 * waited / RATE_HZ)


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
        both = replace(rig(), colour=lens(1280, 800, 90.0, 65.0), depth=lens(848, 480, 87.0, 56.5))
        SoftwareCamera(replace(both, translation_3=np.array([-0.059, 0, 0], np.float32))).record(
            file, scene(words.seconds)
        )
        yardstick = Found(**json.loads(subprocess.check_output([sys.executable, __file__, "--plain", str(file)])))
        ours = fed(file, words.seconds)
    print(f"{'':24}{'core':>8}{'age p50':>10}{'p99, ms':>10}{'images':>8}")
    for name, found in (("plain librealsense", yardstick), ("goshawk-camera", ours)):
        print(f"{name:24}{found.core:8.1%}{found.late_ms()[0]:10.2f}{found.late_ms()[1]:10.2f}{len(found.ages):8}")
    core, added = ours.core - yardstick.core, ours.late_ms()[0] - yardstick.late_ms()[0]
    print(f"goshawk-camera adds {core:.1%} of a core (≤ {TARGET_CORE:.0%}: {verdict(core <= TARGET_CORE)}), ", end="")
    print(f"{added:.2f} ms (≤ {TARGET_MS:g}: {verdict(added <= TARGET_MS)})")
    print(f"for each image its threads waited {ours.waited_ms:.2f} ms for a core: a busy machine adds that")
    record("camera_core_fraction", core)
    if ours.waited_ms <= IDLE_MS:
        record("camera_added_ms", added)


if __name__ == "__main__":
    main()
