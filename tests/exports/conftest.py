"""A real flight's log: one lockstep trial by the built simulator, the same each time."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from goshawk_dashboards.exports import Exported, Format, export_log
from goshawk_dashboards.log.flight import Flight

ROOT = Path(__file__).resolve().parents[2]
SIM = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"), "release", "goshawk-sim")


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """15 s of chase through a forest, with the simulator's truth."""
    folder = tmp_path_factory.mktemp("flight")
    command = [SIM, "fly", "--task", "track", "--speed", "4", "--trials", "1", "--seed", "5", "--log", folder]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("*.mcap")
    return path


@pytest.fixture
def flight(log: Path) -> Flight:
    """It, opened."""
    return Flight.open(log)


@pytest.fixture(scope="session")
def exported(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[Format], Exported]:
    """Its export to a format, made once."""
    folder = tmp_path_factory.mktemp("exports")

    @cache
    def export(format: Format) -> Exported:
        return export_log(Flight.open(log), format, folder / f"flight{format.suffix}")

    return export
