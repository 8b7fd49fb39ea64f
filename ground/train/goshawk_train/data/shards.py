"""Images that stay on disk: the scenes' arrays one after another, read where they are indexed. The processes of a
machine share what its page cache holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Images(Protocol):
    """An array of images, in memory or on disk."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: Any, /) -> NDArray[Any]: ...


class Shards:
    """The frames of all scenes as one array; `then` is done to what was read."""

    def __init__(
        self, scenes: Sequence[NDArray[Any]], then: Callable[[NDArray[Any]], NDArray[Any]] = np.asarray
    ) -> None:
        self.scenes, self.then = scenes, then
        self.starts = np.cumsum([0, *(len(scene) for scene in scenes)])

    def __len__(self) -> int:
        return int(self.starts[-1])

    def __getitem__(self, index: Any, /) -> NDArray[Any]:
        """What an array in memory gives for this index of frames."""
        frame = np.arange(len(self))[index]
        scene = np.searchsorted(self.starts, frame, side="right") - 1
        read = np.empty((*frame.shape, *self.scenes[0].shape[1:]), dtype=self.scenes[0].dtype)
        for place in np.ndindex(frame.shape):
            read[place] = self.scenes[int(scene[place])][frame[place] - self.starts[scene[place]]]
        return self.then(read)
