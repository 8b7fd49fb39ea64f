"""What the vehicle's computer needs before `goshawk-air check` looks at the flight itself."""

from __future__ import annotations

import grp
import os
import resource
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from goshawk_ground.doctor.findings import Finding, note, ok, output
from goshawk_ground.doctor.programs import AIR, onnxruntime, program

VEHICLE_FILE = "etc/goshawk/vehicle.toml"
SERVICE = "goshawk-air.service"
CAMERA = "goshawk-camera"
SERIAL_GROUP = "dialout"


def computer(bin_dir: Path, root: Path = Path("/")) -> Iterator[Finding]:
    """The program with all that it needs, and the processor's clock. ``root``: of the files."""
    yield program(bin_dir / AIR)
    if (bin_dir / AIR).is_file():
        yield onnxruntime(bin_dir / AIR)
    yield _vehicle_file(root / VEHICLE_FILE)
    yield _service()
    yield _real_time(resource.getrlimit(resource.RLIMIT_RTPRIO)[0], os.geteuid() == 0)
    yield _camera()
    yield _serial_ports()
    yield _clock(root / "sys/devices/system/cpu")
    mode = output("nvpmodel", "-q")
    if mode is not None:
        yield ok("power mode", mode)


def _vehicle_file(path: Path) -> Finding:
    if not path.is_file():
        return note("vehicle file", f"no {path}", "write one: docs/how-to/install.md says from what")
    return ok("vehicle file", f"{path}; before a flight: goshawk-air check --config {path}")


def _service() -> Finding:
    state = output("systemctl", "show", "--property=ActiveState", "--value", SERVICE)
    if state == "active":
        return ok("service", "goshawk-air runs")
    todo = "systemctl enable --now goshawk-air, once goshawk-air check says ready"
    return note("service", f"goshawk-air does not run as a service ({state or 'no systemd here'})", todo)


def _real_time(priority: int, root: bool) -> Finding:
    if root or priority == resource.RLIM_INFINITY or priority > 0:
        return ok("real time", "this user may ask for SCHED_FIFO")
    todo = "run goshawk-air as the service, which grants it"
    return note("real time", "this user may not ask for SCHED_FIFO", todo)


def _camera() -> Finding:
    """The driver, and what it opens cameras by: both lie in the same environment."""
    active = os.environ.get("VIRTUAL_ENV")
    folders = [Path(sys.executable).parent, Path.cwd() / ".venv/bin", *([Path(active) / "bin"] if active else [])]
    found = next((folder / CAMERA for folder in folders if (folder / CAMERA).is_file()), None) or shutil.which(CAMERA)
    if found is None:
        todo = "for a RealSense or an OAK-D: make setup-camera in a checkout (docs/how-to/camera.md)"
        return note("camera", f"no {CAMERA} is here", todo)
    python = Path(found).resolve().with_name("python")
    libraries = {"pyrealsense2": "librealsense", "depthai": "depthai"}
    there = [name for package, name in libraries.items() if output(str(python), "-c", f"import {package}") is not None]
    if not there:
        todo = "make setup-camera; on arm64, and for an OAK-D: docs/how-to/camera.md"
        return note("camera", f"{found} has no librealsense", todo)
    return ok("camera", f"{found}, with {' and '.join(there)}; before a flight: {CAMERA} check")


def _serial_ports() -> Finding:
    try:
        member = grp.getgrnam(SERIAL_GROUP).gr_gid in os.getgroups()
    except KeyError:
        member = False
    if member or os.geteuid() == 0:
        return ok("serial ports", "this user may open them")
    todo = f"for an autopilot on one: sudo usermod -aG {SERIAL_GROUP} $USER, then log in again; the service may anyway"
    return note("serial ports", f"this user is not in the group {SERIAL_GROUP}", todo)


def _clock(cpus: Path) -> Finding:
    governors = {file.read_text().strip() for file in sorted(cpus.glob("cpu*/cpufreq/scaling_governor"))}
    if not governors:
        return ok("processor", "no clock control is seen here")
    if governors == {"performance"}:
        return ok("processor", "it keeps its clock")
    todo = "cpupower frequency-set -g performance; on a Jetson jetson_clocks (docs/how-to/jetson.md)"
    return note("processor", f"its clock follows the load ({', '.join(sorted(governors))})", todo)
