"""What a computer says that lacks librealsense, or the rest of Goshawk: one line, and what to do."""

from __future__ import annotations

import subprocess
import sys

import pytest
from camera_process import ROOT, VEHICLE, camera
from goshawk_sensors.setup import profile


def without(package: str, run: str = "from goshawk_sensors.cli import main; main()") -> tuple[str, ...]:
    """Python that runs this on a 64-bit ARM without a package."""
    lacks = f"import platform, sys; platform.machine = lambda: 'aarch64'; sys.modules['{package}'] = None"
    return sys.executable, "-c", f"{lacks}; {run}"


def test_without_librealsense_the_profiles_are_listed_and_one_line_says_what_to_do() -> None:
    done = camera("list", command=without("pyrealsense2"))
    assert (done.returncode, done.stdout) == (1, f"profiles: {', '.join(profile.shipped())}\n")
    (line,) = done.stderr.splitlines()
    assert line.startswith("goshawk-camera: librealsense is not here (") and "docs/how-to/camera.md" in line


@pytest.mark.parametrize(
    "words", [("run",), ("check",), ("run", "--play", "walk.db3"), ("run", "--wait")], ids=" ".join
)
def test_without_librealsense_a_realsense_is_refused_in_one_line(words: tuple[str, ...]) -> None:
    done = camera(*words, "--config", VEHICLE, "--profile", "d455", command=without("pyrealsense2"))
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("goshawk-camera: librealsense is not here (")


def test_an_oak_d_needs_no_librealsense() -> None:
    lacking = without("pyrealsense2", "sys.modules['depthai'] = None; from goshawk_sensors.cli import main; main()")
    done = camera("check", "--config", VEHICLE, "--profile", "oak-d", command=lacking)
    assert done.returncode == 1 and "an OAK-D needs depthai" in done.stderr


def test_without_goshawk_one_line_says_that_the_indexs_is_another() -> None:
    done = camera("check", "--config", VEHICLE, command=without("goshawk_proto"))
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1
    assert line.startswith("goshawk-camera: the package goshawk is not here (")
    assert line.endswith("the package index's goshawk is another project's")


def test_where_librealsense_cannot_be_had_its_tests_are_named_and_left_out() -> None:
    run = "import pytest; sys.exit(pytest.main(['-q', '--collect-only', '-p', 'no:cacheprovider', 'air/sensors']))"
    done = subprocess.run(
        without("pyrealsense2", run), cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    told = "air/sensors: left out, for there is no librealsense (docs/how-to/camera.md, On arm64): "
    assert f"{told}test_lens.py, test_live.py, test_process.py" in done.stdout.splitlines()
    assert "test_resample.py::" in done.stdout and "test_live.py::" not in done.stdout
