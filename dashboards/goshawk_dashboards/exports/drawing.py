"""What exports draw, in the colours of the dashboards. Shapes: N candidates, S samples, P points; rgb 0..255."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_dashboards.scene import curves
from goshawk_dashboards.state.views import Array, PlanView

LIFETIME_S = 0.5
"""A plan or an estimate vanishes from the scene when none has followed for so long: as soon as the vehicle itself calls
a plan stale. No link lies between, so it is less than the live view allows (`SAMPLE_STALE_S`)."""
PATH_SPACING_M = 0.1
_SPEED_STOPS = np.array([(68, 58, 160), (48, 140, 170), (64, 200, 120), (245, 200, 60), (240, 82, 60)], dtype=float)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanLines:
    """A plan's trajectories as lines in the world frame."""

    points_NS3: Array
    rgb_N3: NDArray[np.uint8]
    """Green to red by cost; grey: not a choice."""
    chosen: int | None


def plan_lines(plan: PlanView, samples: int) -> PlanLines:
    """The lines of a plan, coloured as in the live view: one that was merely dearer keeps its colour."""
    points_NS3 = curves.plan_curves_NS3(plan, samples)
    return PlanLines(points_NS3=points_NS3, rgb_N3=curves.colors_N3(plan), chosen=plan.chosen)


def speed_colors_P3(speed_P: Array, top_mps: float) -> NDArray[np.uint8]:
    """From blue at rest to red at ``top_mps`` and above."""
    place_P = np.clip(speed_P / max(top_mps, 1e-6), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_SPEED_STOPS))
    return np.stack([np.interp(place_P, stops, _SPEED_STOPS[:, k]) for k in range(3)], axis=1).astype(np.uint8)


class FlownPath:
    """Where the vehicle has been and how fast, a point every ``PATH_SPACING_M``."""

    def __init__(self, most: int | None = None) -> None:
        """``most``: only so many of the newest points; None: all."""
        self._rows: deque[Array] = deque(maxlen=most)

    def add(self, pos_3: Array, speed_mps: float) -> None:
        """Takes a position if it is far enough from the last one."""
        if not self._rows or float(np.linalg.norm(pos_3 - self._rows[-1][:3])) >= PATH_SPACING_M:
            self._rows.append(np.array([*pos_3, speed_mps]))

    @property
    def points_P3(self) -> Array:
        """The positions."""
        return np.array(self._rows).reshape(-1, 4)[:, :3]

    @property
    def rgb_P3(self) -> NDArray[np.uint8]:
        """Their colours, red at the highest speed."""
        speed_P = np.array(self._rows).reshape(-1, 4)[:, 3]
        return speed_colors_P3(speed_P, float(speed_P.max(initial=0.0)))
