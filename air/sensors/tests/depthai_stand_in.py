"""What `cameras/oak.py` uses of depthai, with the signatures of depthai 3.12.0: a call that it would refuse fails here.

It has no camera. What it delivers follows from what it was asked: the sizes and links of its nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from enum import Enum, auto
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

FOCAL_PX, CENTRE_PX, DEPTH_MM = 600.0, (630.0, 402.0), 2500
"""Of the made-up camera: at the size that is asked for, and everywhere."""
TAKEN = timedelta(seconds=5, milliseconds=40)
"""The middle of each exposure on depthai's clock."""


class CameraBoardSocket(Enum):
    CAM_A, CAM_B, CAM_C = auto(), auto(), auto()


class CameraExposureOffset(Enum):
    START, MIDDLE, END = auto(), auto(), auto()


class ImgFrame:
    class Type(Enum):
        RGB888i, RAW16 = auto(), auto()

    def __init__(self, pixels: NDArray[Any], number: int) -> None:
        self._pixels, self._number = pixels, number

    def getFrame(self) -> NDArray[Any]:
        return self._pixels

    def getTimestamp(self, offset: CameraExposureOffset = CameraExposureOffset.END) -> timedelta:
        return TAKEN if offset is CameraExposureOffset.MIDDLE else TAKEN + timedelta(milliseconds=3)

    def getSequenceNum(self) -> int:
        return self._number


class Input:
    def __init__(self) -> None:
        self.linked: Output | None = None


class Output:
    def __init__(self, pixels: Callable[[], NDArray[Any]], fps: float | None = None) -> None:
        self.pixels, self.fps = pixels, fps

    def link(self, input: Input) -> None:
        assert isinstance(input, Input)
        input.linked = self


class CameraControl:
    def __init__(self) -> None:
        self.said: list[tuple[object, ...]] = []

    def setManualExposure(self, exposureTimeUs: int, sensitivityIso: int) -> CameraControl:
        self.said.append(("manual", exposureTimeUs, sensitivityIso))
        return self

    def setAutoExposureEnable(self) -> CameraControl:
        self.said.append(("automatic",))
        return self


class Camera:
    def __init__(self, _: Pipeline) -> None:
        self.initialControl, self.undistorted = CameraControl(), False

    def build(
        self,
        boardSocket: CameraBoardSocket,
        sensorResolution: tuple[int, int] | None = None,
        sensorFps: float | None = None,
    ) -> Camera:
        assert isinstance(boardSocket, CameraBoardSocket)
        self.socket = boardSocket
        return self

    def requestOutput(
        self,
        size: tuple[int, int],
        type: ImgFrame.Type | None = None,
        resizeMode: object = None,
        fps: float | None = None,
        enableUndistortion: bool | None = None,
        alphaScaling: float | None = None,
    ) -> Output:
        width, height = size
        self.undistorted = enableUndistortion is True
        return Output(lambda: np.full((height, width, 3 if type is ImgFrame.Type.RGB888i else 1), 77, np.uint8), fps)


class StereoDepth:
    def __init__(self, _: Pipeline) -> None:
        self.inputAlignTo, self._size = Input(), (0, 0)
        self.depth = Output(lambda: np.full(self._size[::-1], DEPTH_MM, np.uint16))

    def build(self, left: Output, right: Output, presetMode: object = None) -> StereoDepth:
        assert isinstance(left, Output) and isinstance(right, Output)
        return self

    def setOutputSize(self, width: int, height: int) -> None:
        assert self.inputAlignTo.linked is not None, "only where the depth is brought onto another camera"
        self._size = width, height


class InputMap(dict[str, Input]):
    def __missing__(self, key: str) -> Input:
        self[key] = Input()
        return self[key]


class MessageQueue:
    class QueueException(Exception):  # noqa: N818  # depthai's name; as there, it is no RuntimeError
        pass

    def __init__(self, pipeline: Pipeline, inputs: InputMap) -> None:
        self._pipeline, self._inputs, self._number = pipeline, inputs, 0

    def get(self, timeout: timedelta) -> dict[str, ImgFrame] | None:
        assert isinstance(timeout, timedelta)
        if not self._pipeline.runs or self._pipeline.device.closed:
            raise MessageQueue.QueueException("MessageQueue was closed")
        if self._pipeline.device.silent:
            return None
        self._number += 1
        linked = {name: each.linked for name, each in self._inputs.items() if each.linked is not None}
        return {name: ImgFrame(output.pixels(), self._number) for name, output in linked.items()}


class Sync:
    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline, self.inputs, self.threshold = pipeline, InputMap(), timedelta(0)
        self.out = SimpleNamespace(createOutputQueue=self._queue)

    def setSyncThreshold(self, syncThreshold: timedelta) -> None:
        assert isinstance(syncThreshold, timedelta)
        self.threshold = syncThreshold

    def _queue(self, maxSize: int = 16, blocking: bool = False) -> MessageQueue:
        return MessageQueue(self._pipeline, self.inputs)


class Pipeline:
    def __init__(self, defaultDevice: Device) -> None:
        self.device, self.runs, self.nodes = defaultDevice, False, list[Any]()
        defaultDevice.pipeline = self

    def create(self, kind: Callable[[Pipeline], Any]) -> Any:
        self.nodes.append(kind(self))
        return self.nodes[-1]

    def start(self) -> None:
        self.runs = True

    def stop(self) -> None:
        self.runs = False


class CalibrationHandler:
    def getCameraIntrinsics(
        self, cameraId: CameraBoardSocket, resizeWidth: int = -1, resizeHeight: int = -1
    ) -> list[list[float]]:
        assert cameraId is CameraBoardSocket.CAM_A and min(resizeWidth, resizeHeight) > 0
        return [[FOCAL_PX, 0.0, CENTRE_PX[0]], [0.0, FOCAL_PX, CENTRE_PX[1]], [0.0, 0.0, 1.0]]


class Device:
    plugged: tuple[str, ...] = ("18443010",)
    """The ids of the cameras that are there."""

    def __init__(self, nameOrDeviceId: str | None = None) -> None:
        if not Device.plugged:
            raise RuntimeError("No available devices")
        if nameOrDeviceId is not None and nameOrDeviceId not in Device.plugged:
            raise RuntimeError("Cannot find any device with given deviceInfo")
        self._id = nameOrDeviceId or Device.plugged[0]
        self.silent = self.closed = False
        self.pipeline: Pipeline | None = None
        opened.append(self)

    def getDeviceId(self) -> str:
        return self._id

    def readCalibration(self) -> CalibrationHandler:
        return CalibrationHandler()

    def close(self) -> None:
        self.closed = True


opened: list[Device] = []
"""Each device in the order in which it was opened."""
node = SimpleNamespace(Camera=Camera, StereoDepth=StereoDepth, Sync=Sync)
