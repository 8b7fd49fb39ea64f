"""Data sets: their layout on disk, and what training makes of them (`batches`, `augment`, which alone need torch)."""

from goshawk_train.errors import TrainerError


class DataError(TrainerError):
    """A data set that cannot be used; the message names the file and what is wrong."""
