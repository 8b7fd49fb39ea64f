"""What can go wrong with a camera. Each message is one line that says what to do."""

from __future__ import annotations


class CameraError(Exception):
    """Nothing can be sent until a person changes something."""


class NoCameraError(CameraError):
    """The camera is not there, or not any more: it may come."""


class RecordingError(CameraError):
    """The file that the camera is to be recorded in cannot be written."""


class EndOfRecordingError(Exception):
    """A recording has been played to its end."""
