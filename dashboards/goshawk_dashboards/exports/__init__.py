"""Flight logs for other people's tools: Rerun, CSV, ROS 2 and Foxglove or Lichtblick.

Every export keeps the vehicle's own clock (nanoseconds of its monotonic clock) and its frames: ``world`` is ENU,
``body`` and ``camera`` are FLU, ``camera_optical`` looks along z with y down, as image tools expect.
"""

from pathlib import Path

from goshawk_dashboards.exports.export import Exported, ExportError, Format, export_log

FOXGLOVE_LAYOUT = Path(__file__).with_name("foxglove-layout.json")
"""For Foxglove and Lichtblick: shows what the export for them holds."""

__all__ = ["FOXGLOVE_LAYOUT", "ExportError", "Exported", "Format", "export_log"]
