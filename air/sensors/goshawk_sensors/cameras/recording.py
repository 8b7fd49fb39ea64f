"""A file that librealsense writes while it streams, and how it is known when the file takes no more."""

from __future__ import annotations

from goshawk_sensors.cameras.librealsense import Handle, rs
from goshawk_sensors.cameras.recorder import RecordedFile
from goshawk_sensors.setup.errors import RecordingError

_ENDS = "Stopping recording"
"""How librealsense's notification begins when a file takes no more: it streams on."""


def begin(config: Handle, pipeline: Handle, record: RecordedFile) -> None:
    """All that the pipeline streams goes into the file; what ends that is told.

    The recorder must live in the pipeline alone, so no handle of it is kept: its last words come on a thread that needs
    Python, and only a pipeline that is stopped lets Python go on while it waits for them.

    Raises RecordingError if the file cannot be written, RuntimeError if the camera cannot do what is asked.
    """
    wrapped = rs.pipeline_wrapper(pipeline)
    config.resolve(wrapped)
    config.enable_record_to_file(str(record.path))
    try:
        recorder = config.resolve(wrapped).get_device()
    except RuntimeError as error:
        raise RecordingError(
            f"the recording {record.path} cannot be written: {' '.join(str(error).split())}; see whether its folder is "
            "there and its disk has room"
        ) from error

    def ends(notification: Handle) -> None:
        words = " ".join(notification.get_description().split())
        if words.startswith(_ENDS):  # a camera tells other things by the same way
            record.fail(words.partition("(Error: ")[2].removesuffix(")") or words)

    for sensor in recorder.query_sensors():
        sensor.set_notifications_callback(ends)
    record.begun()
