"""Data sets on disk: their layout, the import of foreign ones, and the check before training. Needs no torch."""


class DataError(ValueError):
    """A data set that cannot be used; the message names the file and what is wrong."""
