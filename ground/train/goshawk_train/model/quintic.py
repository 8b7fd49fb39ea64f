"""The one-segment quintic (eq. 1-2) as constant matrices of its duration T, float64.

Boundary vector d = [f(0), f'(0), f''(0), f(T), f'(T), f''(T)]; coefficients c = M d of t^0..t^5.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


def derivative_row(t: float, order: int) -> F64:
    """The row that gives the polynomial's derivative of `order` at `t` from its coefficients, [6]."""
    row = np.zeros(6)
    for power in range(order, 6):
        row[power] = math.factorial(power) / math.factorial(power - order) * t ** (power - order)
    return row


def hermite(duration: float) -> F64:
    """M of eq. 2, [6, 6]: coefficients from the boundary vector."""
    boundary = np.stack([derivative_row(t, order) for t in (0.0, duration) for order in range(3)])
    return np.linalg.inv(boundary).astype(np.float64)


def gram(duration: float, order: int) -> F64:
    """B = M' Q M, [6, 6]: d' B d is the integral over 0..T of the squared derivative of `order`."""
    q = np.zeros((6, 6))
    for i in range(order, 6):
        for j in range(order, 6):
            factor = math.factorial(i) // math.factorial(i - order) * (math.factorial(j) // math.factorial(j - order))
            power = i + j - 2 * order + 1
            q[i, j] = factor * duration**power / power
    m = hermite(duration)
    return m.T @ q @ m


def sample_rows(duration: float, samples: int) -> F64:
    """Rows that give f, f' and f'' at t = T k / samples, k = 1..samples, from d: [3, samples, 6]."""
    m = hermite(duration)
    times = duration * np.arange(1, samples + 1) / samples
    return np.stack([np.stack([derivative_row(float(t), order) for t in times]) @ m for order in range(3)])
