"""The estimates of a stretch of flight, a row a snapshot: what the charts of the panel draw.

What is felt on the ground is no estimate of the air: a thrust that ramps up under a standing vehicle looks like a
disturbance of one g. Its rows are gaps, so that no scale follows them.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from goshawk_dashboards.instruments.history import SAMPLES, History
from goshawk_dashboards.state.airborne import Ground, Step
from goshawk_dashboards.state.snapshot import IN_AIR, Snapshot
from goshawk_dashboards.state.views import Array, ControlView

AXES = ("east", "north", "up")
ACCELERATIONS = ("desired", "commanded", "measured", "disturbance", "true")
"""What the plan asks for; what attitude and thrust alone would give; what the IMU feels; the observer's estimate; what
a simulation knows."""
COLUMNS = (*(f"{what} {axis}" for what in ACCELERATIONS for axis in AXES), "position", "velocity", "innovation",
           "sigmas", "objectness", "rival", "hover", "lag")  # fmt: skip
_NAN = float("nan")


def sigma_m(covariance_33: Array) -> float:
    """Along the longest axis of the ellipsoid."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance_33)[-1], 0.0)))


class Track:
    """Snapshots of one vehicle in their order, as rows of COLUMNS, in memory that does not grow."""

    def __init__(self, capacity: int = SAMPLES) -> None:
        self._history = History(len(COLUMNS), capacity)
        self._last_ns: int | None = None
        self._flew: bool | None = None
        self._ground = Ground()
        self.gate_sigmas: float | None = None
        """The target filter's, as it was told last."""
        self.took_off_ns: int | None = None
        """When it began to fly, by its own clock; None: that was not seen."""

    @staticmethod
    def of(snaps: Iterable[Snapshot]) -> Track:
        """All of these."""
        listed = list(snaps)
        track = Track(max(len(listed), 1))
        for snap in listed:
            track.add(snap)
        return track

    @property
    def stood_z_m(self) -> float | None:
        """Height of the ground that it took off from, in the world frame; None: it was not seen to stand."""
        return self._ground.stood_z_m

    @property
    def nbytes(self) -> int:
        """Memory held, constant."""
        return self._history.nbytes

    def add(self, snap: Snapshot) -> None:
        """Takes a snapshot, if its controller step is new."""
        control = snap.control
        if control is None or control.stamp_ns == self._last_ns:
            return
        if self._last_ns is not None and control.stamp_ns < self._last_ns:
            self.took_off_ns = None  # another clock: it was started anew
        self._last_ns = control.stamp_ns
        self._watch(control)
        self._ground.take(Step.of(control))
        if snap.target is not None and snap.target.look is not None:
            self.gate_sigmas = snap.target.look.gate_sigmas
        self._history.add(control.stamp_ns * 1e-9, np.array([*self._accelerations(snap), *self._target(snap)]))

    def fill(self, snap: Snapshot) -> None:
        """Takes a snapshot of earlier, of which nothing was known."""
        if snap.control is not None:
            self._ground.tell(Step.of(snap.control))
            row = np.array([*self._accelerations(snap), *self._target(snap)])
            self._history.fill(snap.control.stamp_ns * 1e-9, row)

    def _watch(self, control: ControlView) -> None:
        """Notices a take-off; the time stays after the landing, for what happened is told by it."""
        flies = control.mode in IN_AIR
        if flies and self._flew is False:
            self.took_off_ns = control.stamp_ns
        self._flew = flies

    def tell_take_off(self, stamp_ns: int) -> None:
        """Hears afterwards of a take-off that was not seen here."""
        heard = self._last_ns is not None and stamp_ns <= self._last_ns
        if heard and (self.took_off_ns is None or stamp_ns > self.took_off_ns):
            self.took_off_ns = stamp_ns

    def flight_s(self, stamp_ns: int) -> float | None:
        """Seconds since the last take-off; None: it was not seen."""
        return None if self.took_off_ns is None else (stamp_ns - self.took_off_ns) * 1e-9

    def airborne(self, snap: Snapshot) -> bool:
        """Whether it has left the ground, and has not come back to it."""
        return snap.control is not None and self._ground.airborne(Step.of(snap.control))

    def _accelerations(self, snap: Snapshot) -> list[float]:
        c = snap.control
        if c is None or not self.airborne(snap):
            return [_NAN] * (len(ACCELERATIONS) * len(AXES))
        true_3 = snap.truth.acc_world_3 if snap.truth is not None and snap.fresh("sim_truth") else None
        all_3 = (c.acc_des_world_3, c.acc_att_world_3, c.acc_meas_world_3, c.acc_disturbance_world_3, true_3)
        return [value for acc_3 in all_3 for value in ([_NAN] * 3 if acc_3 is None else acc_3.tolist())]

    def _target(self, snap: Snapshot) -> list[float]:
        target = snap.target if snap.fresh("target") else None
        cov_66, look = (None, None) if target is None else (target.covariance_66, target.look)
        control, innovation_3 = snap.control, None if look is None else look.innovation_world_3
        hover, lag_s = (None, None) if control is None else (control.hover_thrust, control.attitude_lag_s)

        def known(value: float | None, times: float = 1.0) -> float:
            return _NAN if value is None else times * value

        return [
            _NAN if cov_66 is None else sigma_m(cov_66[:3, :3]),
            _NAN if cov_66 is None else sigma_m(cov_66[3:, 3:]),
            _NAN if innovation_3 is None else float(np.linalg.norm(innovation_3)),
            known(look and look.innovation_sigmas),
            known(look and look.objectness),
            known(look and look.rival_objectness),
            known(hover, 100.0),
            known(lag_s, 1e3),
        ]

    def window(self, seconds: float) -> tuple[Array, dict[str, Array]]:
        """Times relative to the newest row, and each column, of the last ``seconds``."""
        ago, rows = self._history.window(seconds)
        return ago, dict(zip(COLUMNS, rows.T, strict=True))
