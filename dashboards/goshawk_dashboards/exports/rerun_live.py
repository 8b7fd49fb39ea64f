"""A vehicle in flight for a Rerun viewer that runs already: the entities of the export, by the viewer's gRPC."""

from __future__ import annotations

import rerun as rr

from goshawk_dashboards.exports.rerun_file import APPLICATION, Log, blueprint
from goshawk_dashboards.exports.source import Record

FLUSH_NS = 500_000_000
"""What goes as columns, the vehicle's own motion, is sent so often."""
PATH_POINTS = 2000
"""The last 200 m of the flown path."""


class RerunViewer:
    """Sends one vehicle to a viewer. For one thread."""

    def __init__(self, name: str, address: str) -> None:
        """``address``: such as rerun+http://127.0.0.1:9876/proxy. Raises OSError, one line, if it cannot be one.

        A viewer that is not there yet is waited for; meanwhile messages are dropped.
        """
        self._recording = rr.RecordingStream(APPLICATION, recording_id=name)
        try:
            self._recording.connect_grpc(address, default_blueprint=blueprint())
        except (RuntimeError, ValueError) as error:
            raise OSError(f"'{address}' is no address of a Rerun viewer: {error}") from error
        self._log = Log(self._recording, PATH_POINTS)
        self._flushed_ns = 0
        self.url = address

    def take(self, record: Record) -> None:
        """Sends a message, or keeps it for the next half second."""
        self._log.take(record)
        if not 0 <= record.log_ns - self._flushed_ns < FLUSH_NS:
            self._flushed_ns = record.log_ns
            self._flush()

    def close(self) -> None:
        """Ends the recording; it stays in the viewer."""
        self._flush()
        self._recording.disconnect()

    def _flush(self) -> None:
        self._log.flush()
        self._log.draw_path()
