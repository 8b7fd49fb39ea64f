"""Data sets: their layout on disk, and what training makes of them (`batches`, `augment`, which alone need torch)."""

from collections.abc import Callable

from goshawk_train.errors import TrainerError

Progress = Callable[[str, int, int], None]
"""Told what is done, how many of it, of how many."""


def unheard(*_: object) -> None:
    """A ``Progress`` that tells nobody."""


class DataError(TrainerError):
    """A data set that cannot be used; the message names the file and what is wrong."""
