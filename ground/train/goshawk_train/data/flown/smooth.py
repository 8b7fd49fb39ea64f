"""What all measurements of a motion together say of it: a Kalman filter and its Rauch-Tung-Striebel smoother.

Shape letters: T times, M numbers of a measurement, 6 position and velocity, 3 a world vector.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

_FIRST_POSITION_M, _FIRST_VELOCITY_MPS = 100.0, 10.0
"""Standard deviations of what is known before the first measurement."""


@dataclass(frozen=True, kw_only=True)
class Smoothed:
    """Position and velocity at each time, and their covariance."""

    mean_T6: F64
    covariance_T66: F64

    @property
    def pos_T3(self) -> F64:
        """The positions."""
        return self.mean_T6[:, :3]

    @property
    def std_T(self) -> F64:
        """Standard deviation of the position in its most doubtful direction, m."""
        return np.sqrt(np.linalg.eigvalsh(self.covariance_T66[:, :3, :3])[:, -1])


def smooth(
    times_T: F64, measured_T: NDArray[np.bool_], value_TM: F64, noise_TMM: F64, *, acceleration: float
) -> Smoothed:
    """The motion at ascending times, of which some are measured.

    A measurement is the position (M = 3) or position and velocity (M = 6). In between the velocity walks randomly;
    `acceleration` is the power density of that, m²/s³. Times before the first measurement are told from later ones.
    """
    count, size = value_TM.shape
    observe: F64 = np.eye(6)[:size]
    first = int(np.argmax(measured_T))
    mean: F64 = np.zeros(6)
    covariance: F64 = np.diag([_FIRST_POSITION_M**2] * 3 + [_FIRST_VELOCITY_MPS**2] * 3)
    mean[:size] = value_TM[first]
    transition_T66: F64 = np.zeros((count, 6, 6)) + np.eye(6)
    predicted_T6, predicted_T66 = np.zeros((count, 6)), np.zeros((count, 6, 6))
    mean_T6, covariance_T66 = np.zeros((count, 6)), np.zeros((count, 6, 6))
    for t in range(count):
        if t:
            step = times_T[t] - times_T[t - 1]
            transition_T66[t, :3, 3:] = step * np.eye(3)
            mean = transition_T66[t] @ mean
            covariance = transition_T66[t] @ covariance @ transition_T66[t].T + acceleration * _walk(step)
        predicted_T6[t], predicted_T66[t] = mean, covariance
        if measured_T[t]:
            gain = _solve(
                observe @ covariance @ observe.T + noise_TMM[t], observe @ covariance
            ).T  # of symmetric matrices
            mean = mean + gain @ (value_TM[t] - observe @ mean)
            rest: F64 = np.eye(6) - gain @ observe
            covariance = rest @ covariance @ rest.T + gain @ noise_TMM[t] @ gain.T
        mean_T6[t], covariance_T66[t] = mean, covariance
    for t in range(count - 2, -1, -1):
        back = _solve(predicted_T66[t + 1], transition_T66[t + 1] @ covariance_T66[t]).T
        mean_T6[t] += back @ (mean_T6[t + 1] - predicted_T6[t + 1])
        covariance_T66[t] += back @ (covariance_T66[t + 1] - predicted_T66[t + 1]) @ back.T
    return Smoothed(mean_T6=mean_T6, covariance_T66=covariance_T66)


def _solve(matrix: F64, right: F64) -> F64:
    return cast("F64", np.linalg.solve(matrix, right))


def _walk(step: float) -> F64:
    """Covariance that a random walk of the velocity adds in `step` seconds, of density 1."""
    return cast("F64", np.kron(np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]]), np.eye(3)))
