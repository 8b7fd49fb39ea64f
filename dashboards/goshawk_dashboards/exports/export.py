"""One entry for all formats: checks what is asked, writes beside the destination, and gives it its name at the end."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from goshawk_dashboards.exports.csv_files import write_csv
from goshawk_dashboards.exports.source import Record, records
from goshawk_dashboards.log.flight import Flight


class ExportError(RuntimeError):
    """The export cannot be made; one line says why and what to do."""


class Format(StrEnum):
    """What ``export_log`` writes."""

    FOXGLOVE = "foxglove"
    RERUN = "rerun"
    ROS2 = "ros2"
    CSV = "csv"

    @property
    def suffix(self) -> str:
        """What a name gets in place of the log's ".mcap"."""
        return {Format.FOXGLOVE: ".foxglove.mcap", Format.RERUN: ".rrd", Format.ROS2: ".ros2.mcap", Format.CSV: "_csv"}[
            self
        ]


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What was written."""

    path: Path
    format: Format
    counts: dict[str, int]
    """Messages by topic; for CSV rows by file, for Rerun rows by entity."""


def export_log(flight: Flight, format: Format, output: Path) -> Exported:
    """Exports a flight. A folder for CSV, one file otherwise; never overwrites.

    Raises ExportError.
    """
    if output.exists():
        raise ExportError(f"{output} exists already: give another -o, or remove it")
    write = _writer(format)
    unfinished = output.with_name(f".{output.name}.unfinished")
    try:
        _discard(unfinished)
        if format is Format.CSV:
            unfinished.mkdir()
        counts = write(records(flight), unfinished)
        unfinished.rename(output)
    except OSError as error:
        raise ExportError(f"cannot write {output}: {error.strerror or error}") from error
    finally:
        with contextlib.suppress(OSError):
            _discard(unfinished)
    return Exported(path=output, format=format, counts=counts)


def _writer(format: Format) -> Callable[[Iterable[Record], Path], dict[str, int]]:
    """Imports what a format needs only when it is asked for: some of it is large, Rerun's is an extra."""
    match format:
        case Format.CSV:
            return write_csv
        case Format.FOXGLOVE:
            from goshawk_dashboards.exports.foxglove import write_foxglove

            return write_foxglove
        case Format.ROS2:
            from goshawk_dashboards.exports.ros2 import write_ros2

            return write_ros2
        case Format.RERUN:
            try:
                from goshawk_dashboards.exports.rerun_file import write_rerun
            except ModuleNotFoundError as error:
                raise ExportError(
                    "rerun needs the package rerun-sdk, which is not installed: make setup-rerun"
                ) from error
            return write_rerun


def _discard(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
