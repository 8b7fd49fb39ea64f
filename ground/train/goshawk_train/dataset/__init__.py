"""Data sets on disk: their layout, the import of foreign ones, and the check before training. Needs no torch."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Told what is done, how many of it, of how many."""


class DataError(ValueError):
    """A data set that cannot be used; the message names the file and what is wrong."""
