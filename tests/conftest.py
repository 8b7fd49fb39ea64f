"""What every test needs of its process."""

from __future__ import annotations

import gc

import pytest


@pytest.fixture(autouse=True, scope="module")
def searched_for_garbage() -> None:
    """What the tests before have left is searched for garbage now, and not again until the next file.

    A search of all of it stops every thread for up to half a second. Whoever stands in here for a driver, an autopilot
    or a hand would fall silent for longer than a vehicle allows, in the middle of a flight.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()
