"""Cuts a flight into phases by what its controller and its target filter logged. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from numpy.typing import NDArray

from goshawk_dashboards.state import words
from goshawk_dashboards.state.views import UNSEEN_S, Array

NAMES: Mapping[int, str] = {
    pb.MODE_IDLE: "on the ground",
    pb.MODE_READY: "on the ground",
    pb.MODE_TAKEOFF: "take-off",
    pb.MODE_TRACK: "tracking",
    pb.MODE_NAVIGATE: "navigation",
    pb.MODE_STOPPING: "landing",
}
"""A mode's phase where it is not the mode's own name. Tracking has a second one, "lost"."""


@dataclass(frozen=True, kw_only=True)
class Phase:
    """One interval of a flight, seconds since its start."""

    name: str
    start_s: float
    end_s: float
    """The start of what follows; of the last one the last record."""

    @property
    def duration_s(self) -> float:
        """How long it lasted."""
        return self.end_s - self.start_s

    @staticmethod
    def runs(times_s: Array, labels: NDArray[Any]) -> tuple[Phase, ...]:
        """Equal neighbours joined: one phase for each run of a label, which is its name."""
        if len(labels) == 0:
            return ()
        starts = np.flatnonzero(np.concatenate([[True], labels[1:] != labels[:-1]]))
        ends_s = np.append(times_s[starts[1:]], times_s[-1])
        return tuple(
            Phase(name=str(labels[k]), start_s=float(times_s[k]), end_s=float(end_s))
            for k, end_s in zip(starts, ends_s, strict=True)
        )


def phases_of(
    times_s: Array, modes: NDArray[Any], target_times_s: Array, target: Mapping[str, NDArray[Any]]
) -> tuple[Phase, ...]:
    """Phases from the mode at each controller step and from the target filter.

    "on the ground", "take-off", "tracking", "lost" (tracking a target unseen for ``UNSEEN_S``, or without an
    estimate), "search", "navigation", "hold", "landing", "landed", "fault".
    """
    codes, which = np.unique(modes, return_inverse=True)
    met = [int(code) for code in codes]
    if len(codes) == 0:
        return ()
    names = np.array([NAMES.get(mode) or words.mode(mode) for mode in met], dtype=object)[which]
    tracking = names == NAMES[pb.MODE_TRACK]
    if tracking.any():
        newest = np.searchsorted(target_times_s, times_s, side="right") - 1
        seen = np.zeros(len(times_s), dtype=bool)
        some = newest >= 0
        # Between two estimates a target stays unseen longer than the last one said.
        unseen_s = target["since_seen_s"][newest[some]] + times_s[some] - target_times_s[newest[some]]
        seen[some] = target["confirmed"][newest[some]].astype(bool) & (unseen_s <= UNSEEN_S)
        names[tracking & ~seen] = "lost"
    return Phase.runs(times_s, names)
