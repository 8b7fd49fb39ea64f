"""Flight logs for other people's tools: Rerun, CSV, ROS 2 and Foxglove or Lichtblick.

Every export keeps the vehicle's own clock (nanoseconds of its monotonic clock) and its frames: ``world`` is ENU,
``body`` and ``camera`` are FLU, ``camera_optical`` looks along z with y down, as image tools expect.
"""

from goshawk_dashboards.exports.export import Exported, ExportError, Format, export_log

__all__ = ["ExportError", "Exported", "Format", "export_log"]
